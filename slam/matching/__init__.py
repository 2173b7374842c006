"""Scan matching: the pose at which the points of a scan lie on surfaces."""
