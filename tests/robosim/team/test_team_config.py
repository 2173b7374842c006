"""Configuration of a team."""

from typing import Any

import jaxtyping
import pytest

from robosim.team.team_config import TeamConfig


def test_team_config_counts_robots_and_models() -> None:
    assert TeamConfig().size == 1
    assert TeamConfig(robots="3").names == ("robot1", "robot2", "robot3")
    mixed = TeamConfig(robots="jackal, turtlebot4")
    assert (mixed.size, mixed.models) == (2, ("jackal", "turtlebot4"))


@pytest.mark.parametrize(
    "robots",
    [
        *("0", "101", "", "jackal,", ",2", "jackal", "-1", "2.5", "+2", " 2", "\u00b2", "\u0663", "9" * 5000),
        *(",".join(["jackal"] * 101), 2, None, ["jackal", "turtlebot4"]),
    ],
)
def test_team_config_rejects_robots(robots: Any, monkeypatch) -> None:
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)  # it would be first to complain
    with pytest.raises(ValueError, match="robots is"):
        TeamConfig(robots=robots)


@pytest.mark.parametrize(
    "lose", ["3@10", "0@10", "robot1@5", "1", "1@", "1@-3", "1@0", "\u00b2@3", "1@\u00b2", 7]
)
def test_team_config_rejects_losses(lose: Any, monkeypatch) -> None:
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)  # it would be first to complain
    with pytest.raises(ValueError, match=r"team\.lose is"):
        TeamConfig(robots="2", lose=(lose,))


def test_team_config_rejects_losses_that_mean_nothing() -> None:
    """The loss of the only robot, and two losses of the same robot."""
    with pytest.raises(ValueError, match="of a robot of a team"):
        TeamConfig(lose=("1@5",))
    with pytest.raises(ValueError, match="1@9 01@5, expected each robot once"):
        TeamConfig(robots="3", lose=("1@9", "01@5"))


def test_team_config_loses_robots_from_a_decision_on() -> None:
    config = TeamConfig(robots="2", lose=("2@10",))
    assert [config.is_lost("robot2", k) for k in (9, 10, 11)] == [False, True, True]
    assert not config.is_lost("robot1", 50)
