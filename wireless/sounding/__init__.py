"""Sounding: what a receiver measures of paths."""
