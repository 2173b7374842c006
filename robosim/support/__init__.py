"""Support of every command: files written whole, progress, interrupts, stopwatches, shipped assets."""
