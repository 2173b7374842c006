"""Estimation: from measurements to paths again."""
