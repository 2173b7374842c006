"""What every command stands on: files written whole, progress, interrupts, stopwatches, shipped assets."""
