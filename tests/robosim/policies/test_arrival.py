"""Goals along arrivals."""

import numpy as np
import pytest

from robosim.policies.arrival import Approach, FollowArrival, FollowConfig, StuckDetector
from robosim.radio.measurement import Measurement
from wireless.paths import LinkState

BOTH = (LinkState.LOS, LinkState.FIRST_ORDER)


def measurement(state=LinkState.LOS, aoa=0.5, snr_db=30.0, n=1) -> Measurement:
    ones = np.ones(n)
    return Measurement(
        pose=np.zeros(3),
        aoa_rad=aoa * ones,
        aod_rad=0 * ones,
        snr_db=snr_db * ones,
        gain_db=-80 * ones,
        delay_s=0 * ones,
        probability=np.eye(4)[state],
    )


def test_the_goal_lies_ahead_along_the_arrival():
    goal = FollowArrival(BOTH).goal(measurement(aoa=2.0), np.array([1.0, 2.0, 0.3]))
    assert goal == pytest.approx([1 + 0.6 * np.cos(2.0), 2 + 0.6 * np.sin(2.0)])


@pytest.mark.parametrize(
    "what",
    [
        measurement(LinkState.HIGHER_ORDER),
        measurement(LinkState.OUTAGE),
        measurement(snr_db=9.9),
        measurement(n=0),
    ],
    ids=["higher order", "outage", "weak", "nothing"],
)
def test_untrusted_arrivals_are_not_followed(what):
    assert FollowArrival(BOTH).goal(what, np.zeros(3)) is None


def test_first_order_is_followed_only_if_it_is_trusted():
    assert FollowArrival((LinkState.LOS,)).goal(measurement(LinkState.FIRST_ORDER), np.zeros(3)) is None
    assert FollowArrival(BOTH).goal(measurement(LinkState.FIRST_ORDER), np.zeros(3)) is not None


def test_a_goal_stays_until_its_time_is_over_or_it_is_reached():
    follow, pose = FollowArrival(BOTH), np.zeros(3)
    first = follow.goal(measurement(aoa=0.0), pose)
    assert all(np.array_equal(follow.goal(measurement(aoa=1.0), pose), first) for _ in range(9))
    assert follow.goal(measurement(aoa=1.0), pose) == pytest.approx([0.6 * np.cos(1), 0.6 * np.sin(1)])
    near = np.array([0.6 * np.cos(1) - 0.1, 0.6 * np.sin(1), 0.0])
    assert follow.goal(measurement(aoa=0.0), near) == pytest.approx([near[0] + 0.6, near[1]])


def test_a_stuck_robot_ignores_arrivals_longer_each_time():
    """It stands still: 29 decisions of following, then 50 without, 29 and 100, and so on."""
    follow, pose = FollowArrival(BOTH, FollowConfig(stuck_steps=30, leave_steps=50)), np.zeros(3)
    followed = np.array([follow.goal(measurement(), pose) is not None for _ in range(400)])
    changes = np.flatnonzero(np.diff(followed)) + 1
    assert changes[:4].tolist() == [29, 80, 109, 210]
    assert followed[0]


def test_a_robot_that_returns_repeatedly_ignores_arrivals():
    """To and fro over 2 m, as in front of a gap: arrivals are ignored within 120 decisions.

    It never stays: half of any 30 decisions are more than half a metre away.
    """
    follow = FollowArrival(BOTH)
    x = np.abs(np.arange(400) % 40 - 20) * 0.1
    poses = np.column_stack([x, np.zeros((400, 2))])
    followed = np.array([follow.goal(measurement(aoa=0.0), pose) is not None for pose in poses])
    assert followed[:40].all()
    assert 40 <= np.flatnonzero(~followed)[0] < 120
    detector = StuckDetector(30, 0.5)
    assert not any(detector.is_stuck(pose[:2]) for pose in poses)


def test_a_robot_that_advances_continues_to_follow():
    follow = FollowArrival(BOTH)
    path = np.column_stack([0.05 * np.arange(200), np.zeros(200), np.zeros(200)])
    assert all(follow.goal(measurement(aoa=0.0), pose) is not None for pose in path)


def test_an_approach_is_vain_where_the_robot_comes_no_nearer():
    """Ten decisions after the nearest one; any progress, or another place, begins again."""
    place, approach = np.zeros(2), Approach(10)
    assert not any(approach.is_vain(place, 9.0 - 0.2 * i, i) for i in range(30))
    vain = [approach.is_vain(place + 0.3, 4.0, i) for i in range(30, 45)]
    assert vain == [i - 29 >= 10 for i in range(30, 45)]
    assert not approach.is_vain(place + 2.0, 4.0, 45)
