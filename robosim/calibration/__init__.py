"""Calibration of materials and walls by measured paths and received powers."""
