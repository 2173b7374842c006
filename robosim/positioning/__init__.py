"""Positions of beacons from powers received along a route."""
