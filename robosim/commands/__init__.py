"""Commands of `robosim`, a group of commands per file; `robosim.cli` lists them."""
