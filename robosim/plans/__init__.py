"""Floor plans: what one is, and reading and writing it in the formats that others use."""
