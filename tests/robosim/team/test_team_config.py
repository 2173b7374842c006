"""Configuration of a team."""

import pytest

from robosim.team.team_config import TeamConfig


def test_team_config_counts_robots_and_models() -> None:
    assert TeamConfig().size == 1
    assert TeamConfig(robots="3").names == ("robot1", "robot2", "robot3")
    mixed = TeamConfig(robots="jackal, turtlebot4")
    assert (mixed.size, mixed.models) == (2, ("jackal", "turtlebot4"))


@pytest.mark.parametrize("robots", ["0", "101", "", "jackal,", ",2"])
def test_team_config_rejects_robots(robots: str) -> None:
    with pytest.raises(ValueError, match="robots is"):
        TeamConfig(robots=robots)


@pytest.mark.parametrize("lose", ["3@10", "0@10", "robot1@5", "1", "1@", "1@-3"])
def test_team_config_rejects_losses(lose: str) -> None:
    with pytest.raises(ValueError, match=r"team\.lose is"):
        TeamConfig(robots="2", lose=(lose,))


def test_team_config_loses_robots_from_a_decision_on() -> None:
    config = TeamConfig(robots="2", lose=("2@10",))
    assert [config.is_lost("robot2", k) for k in (9, 10, 11)] == [False, True, True]
    assert not config.is_lost("robot1", 50)
