"""Planning: cost maps, and the cheapest path to a goal on a growing map."""
