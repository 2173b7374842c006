"""Figures for papers and posters."""
