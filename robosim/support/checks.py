"""What configurations are checked by where they are made, and bounds that many of them share."""

from collections.abc import Collection

from slam.support.checks import check_choice, check_number, check_numbers, shown

__all__ = ["check_choice", "check_number", "check_numbers", "check_some", "shown"]

#: Seeds that all that draws here takes.
SEED = 0, 2**63 - 1
#: What a command that goes through plans expects of them.
PLANS = "floor plans, or folders of them"
#: Levels of noise, 1 being what was published.
LEVEL = 0, 100, "times what was published: 0 for no noise"
#: Carrier frequencies that the laws of materials and antennas here are meant for [Hz].
FREQUENCY_HZ = 1e8, 1e12, "Hz. 28 GHz are 28e9"
#: Coordinates beyond lie on no plan of a building [m].
FARTHEST = 1e7
#: Radii of robots' hulls.
RADIUS_M = 0.001, 5, "m"
#: Actions of an episode, decisions of a walk.
STEPS = 1, 1_000_000
#: Tasks of a plan, and episodes of a task.
TASKS = 1, 10_000
#: Sides of square pictures.
SIZE_PX = 8, 4096, "pixels"


def check_some(name: str, values: Collection[object], expected: str) -> None:
    """See that there is at least one of several values.

    Raises:
        ValueError: If there is none.
    """
    if not values:
        raise ValueError(f"{name} is empty, expected {expected}.")
