"""What all of the package stands on: checks, files from outside, compiled inner loops, weights."""
