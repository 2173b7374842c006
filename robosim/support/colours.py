"""Colours of what pictures of plans and episodes show."""

WALL = "#56B4E9"
FURNISHING = "#8C6D46"
TRUE = "#009E73"
ESTIMATE = "#E69F00"
TARGET = "#D55E00"
