"""Support of all of the package: files from outside, and compiled inner loops."""
