"""Logs of real robots: reading them, and the map and trajectory that they hold."""
