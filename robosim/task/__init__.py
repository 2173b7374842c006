"""What a robot is to do, how much of the building it has seen, and the record of how it went."""
