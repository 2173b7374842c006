"""Ranges that many configurations share, and the checks of `robosim_support.checks`."""

from collections.abc import Collection

from robosim_support.checks import Range, check_arguments, check_choice, check_number, checked, shown

__all__ = [
    "ADVANCED",
    "Range",
    "check_arguments",
    "check_choice",
    "check_number",
    "check_some",
    "checked",
    "shown",
]

#: Marks the type of an option, or of a group of options, that only `--help-all` shows.
ADVANCED = "advanced"
#: Seeds of random numbers.
SEED = Range(0, 2**63 - 1)
#: What a command expects of the plans that it goes through.
PLANS = "floor plans, or folders of them"
#: Levels of noise.
LEVEL = Range(0, 100, "times what was published", "0 is no noise.")
#: Carrier frequencies that the models of materials and antennas are meant for.
FREQUENCY_HZ = Range(1e8, 1e12, "Hz", "28 GHz are 28e9.")
#: Coordinates beyond lie on no plan of a building [m].
FARTHEST = 1e7
#: Radii of robots' hulls.
RADIUS_M = Range(0.001, 5, "m")
#: Actions of an episode, decisions of a walk.
STEPS = Range(1, 1_000_000)
#: Tasks of a plan, and episodes of a task.
TASKS = Range(1, 10_000)
#: Sides of square pictures.
SIZE_PX = Range(8, 4096, "pixels", "Try 128.")


def check_some(name: str, values: Collection[object], expected: str) -> None:
    """Raise ValueError if there is none of several values."""
    if not values:
        raise ValueError(f"{name} is empty, expected {expected}.")
