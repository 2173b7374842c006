"""Readers of floor plans, one file format each; `robosim.planfiles` picks among them."""
