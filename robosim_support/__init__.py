"""What `robosim`, `slam` and `wireless` share: compiled loops, checks, files, public names."""
