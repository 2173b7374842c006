"""Control: from a plan to the next action."""
