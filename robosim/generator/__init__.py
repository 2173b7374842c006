"""The parts that `robosim.generator.generate` invents buildings from, and the statistics it is judged by."""
