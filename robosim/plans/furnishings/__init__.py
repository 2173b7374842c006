"""Furnishings of a building: any mesh at a place, and pieces of furniture made from boxes."""
