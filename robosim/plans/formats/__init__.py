"""Readers of floor plans, one file format each; `robosim.plans.files` picks among them."""
