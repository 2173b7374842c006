"""What the `robosim` command can do, one group of commands a file; `robosim.cli` lists them."""
