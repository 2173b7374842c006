"""Exploration: choice of the next frontier."""
