"""Positions of radios from received powers."""
