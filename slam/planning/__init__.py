"""Planning: what a metre costs, and the cheapest way to a goal on a map that grows."""
