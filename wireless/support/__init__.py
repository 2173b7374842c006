"""What all of the package stands on: files from outside, and compiled inner loops."""
