"""The parts that `robosim.generate` invents buildings from, and the statistics it is judged by."""
