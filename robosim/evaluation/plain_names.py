"""What the columns of an evaluation are called where people read them; each with its unit."""

NAMES = {
    "arrived": "arrived [share of episodes]",
    "arrived_at_step": "arrived after [actions]",
    "steps": "actions done",
    "path_length_m": "distance driven [m]",
    "shortest_m": "shortest path [m]",
    "spl": "success weighted by path length (SPL)",
    "soft_spl": "the same with progress in place of success (soft SPL)",
    "final_distance_m": "distance to the target at the end [m]",
    "collisions": "actions that ended at something",
    "deepest_penetration_m": "deepest in a wall, by the physics [m]",
    "deepest_by_distance_m": "deepest in a wall, by distance [m]",
    "coverage": "floor seen [share]",
    "coverage_250": "floor seen after 250 actions [share]",
    "coverage_500": "floor seen after 500 actions [share]",
    "coverage_1000": "floor seen after 1000 actions [share]",
    "position_error_rms_m": "error of the position, root mean square [m]",
    "position_error_last_m": "error of the position at the end [m]",
    "simulated_s": "simulated time [s]",
    "oracle_steps": "actions of the oracle",
    "relative_time": "actions over those of the oracle",
    "limit_time": "actions over those of shortest",
    "link_state_accuracy": "link state classified correctly [share of decisions]",
    "los_share": "in line of sight [share of decisions]",
    "los_aoa_within_5_deg": "in line of sight: arrival within 5° [share]",
    "first_order_share": "first-order links [share of decisions]",
    "first_order_aoa_within_5_deg": "first order: arrival within 5° [share]",
    "higher_order_share": "higher-order links [share of decisions]",
    "higher_order_aoa_within_5_deg": "higher order: arrival within 5° [share]",
    "transmitter_std_m": "transmitter as mapped: standard deviation [m]",
    "transmitter_error_m": "transmitter as mapped: error [m]",
    "scene": "building, robot and radio made ready",
    "wall": "all, by the clock",
    "decisions_per_s": "decisions a second",
}


def plain_name(column: str) -> str:
    """What people read in place of a column's name; of an unknown one its words."""
    return NAMES.get(column, column.replace("_", " "))
