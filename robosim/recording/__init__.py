"""Logs of decisions, and what is drawn from them afterwards."""
