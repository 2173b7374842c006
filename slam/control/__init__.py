"""Control: the next action along a plan."""
