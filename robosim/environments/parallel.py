"""Several robots as agents of PettingZoo, which is imported where an environment is made."""

from typing import TYPE_CHECKING, Any

from robosim.simulator import SimulatorConfig
from robosim.support.installation import missing_extra

if TYPE_CHECKING:
    from robosim.environments.target_search_team import TargetSearchTeam


def parallel_env(
    plan: object = "flat",
    *,
    robots: int = 2,
    config: SimulatorConfig | None = None,
    max_steps: int = 1000,
    render_mode: str | None = None,
    **search: Any,
) -> "TargetSearchTeam":
    """Make a search of several robots in one world, with PettingZoo's parallel API; nothing is built before a reset.

    Args:
        plan: Source of plans: see `robosim.environments.sources`.
        robots: Number of robots, all alike.
        config: Configuration of the simulator of each robot; by default the fastest with the needed sensors.
        max_steps: Steps after which a search is truncated.
        render_mode: None or "rgb_array".
        search: Fields of `SearchConfig`.

    Raises:
        ImportError: If PettingZoo, of the extra `team`, is not installed.
        ValueError: If a number is out of bounds, the render mode unknown, or a robot lacks a sensor that it observes
            by.
        MapError: If there is no such plan.
    """
    try:
        from robosim.environments.target_search_team import TargetSearchTeam
    except ImportError as error:
        if (error.name or "").partition(".")[0] != "pettingzoo":
            raise
        raise missing_extra("pettingzoo", "An environment of several robots") from error
    return TargetSearchTeam(
        plan, robots=robots, config=config, max_steps=max_steps, render_mode=render_mode, **search
    )
