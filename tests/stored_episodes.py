"""Rows of episodes that were never run, whole enough to be read back."""


def row(plan, task, policy, target, *, steps=30, arrived=True, seed=1) -> dict:
    """The row of an episode that reaches its target in the last of its steps, or nowhere."""
    return {
        "plan": plan, "task": task, "policy": policy, "repeat": 0, "seed": seed,
        "ended": "arrived" if arrived else "out of steps", "arrived": arrived,
        "arrived_at_step": steps if arrived else None, "steps": steps, "collisions": 0,
        "spl": 0.5 * arrived, "shortest_m": 3.0, "final_distance_m": 0.1, "path_length_m": 6.0, "coverage": 0.5,
        "deepest_penetration_m": 0.0, "deepest_by_distance_m": 0.0, "position_error_rms_m": 0.01,
        "start": [1.0, 0.6, 0.0], "target": list(target),
    }  # fmt: skip
