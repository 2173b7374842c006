"""Measurements of speed against error, run by ``robosim bench``."""
