"""What stands in a building beside its walls: any mesh at a place, and pieces of furniture made from boxes."""
