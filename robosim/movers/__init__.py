"""People and other things that move in a building by themselves."""
