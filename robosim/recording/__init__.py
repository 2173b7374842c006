"""Recorded steps of episodes, and their replay."""
