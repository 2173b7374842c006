"""Support of all of the package: checks, files from outside, compiled inner loops, weights."""
