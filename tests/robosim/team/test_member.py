"""What a robot of a team knows of the others."""

from dataclasses import replace

import numpy as np
import pytest

from robosim.policies.estimates import Estimates
from robosim.policies.reason import ARRIVAL, EXPLORE, Reason
from robosim.step import Decision
from robosim.team.member import Member, Status
from slam.actions import Action
from slam.control.avoidance import Avoidance
from slam.grid import GridFrame, MapEstimate
from slam.hull import Hull


def _map(x: float, *, seen: bool = True) -> MapEstimate:
    shape = (80, 80)
    explored = np.zeros(shape, bool)
    explored[10:30, 10:30] = seen
    return MapEstimate(
        frame=GridFrame(origin_xy=(0.0, 0.0), resolution_m=0.05, shape=shape),
        obstacle_probability=np.where(explored, 0.1, 0.5).astype(np.float32),
        explored=explored,
        blocked=np.zeros(shape, bool),
        pose=np.array([x, 1.0, 0.0]),
    )


def _decision(estimate: MapEstimate, reason: Reason = EXPLORE) -> Decision:
    return Decision(
        goal=np.array([3.0, 1.0]),
        reason=reason,
        path=np.array([[1.0, 1.0], [3.0, 1.0]]),
        command=Action.FORWARD,
        estimates=Estimates(estimate),
    )


def _decide(member: Member, own_map: MapEstimate) -> MapEstimate:
    member.begin(own_map)
    return member.merged(own_map)


def _send(sender: Member, receiver: Member) -> None:
    for subject in ("status", "measurement", "tile"):
        for note in sender.notes.news_for(receiver.notes, subject):
            receiver.receive(note)


@pytest.mark.parametrize("every", [1, 10])
def test_member_knows_place_plan_and_map_of_the_other(every: int) -> None:
    first, second = (Member(name, k, Hull(radius_m=0.1), every) for k, name in enumerate("ab"))
    estimate = _decide(first, _map(1.0))
    first.report(estimate, _decision(estimate))
    _send(first, second)
    merged = _decide(second, _map(2.0, seen=False))
    assert merged.explored.sum() == 400
    (claim,) = merged.claims
    assert claim.cost_m == pytest.approx(2.0)
    (robot,) = merged.moving
    # It has decided, and goes ahead now.
    assert robot.xy.tolist() == [1.0, 1.0]
    assert robot.velocity.tolist() == [0.25, 0.0]


@pytest.mark.parametrize(("reason", "to_target"), [(EXPLORE, False), (ARRIVAL, True)])
def test_member_claim_says_whether_the_other_expects_the_target(reason: Reason, to_target: bool) -> None:
    first, second = (Member(name, k, Hull(radius_m=0.1), 10) for k, name in enumerate("ab"))
    estimate = _decide(first, _map(1.0))
    first.report(estimate, _decision(estimate, reason))
    _send(first, second)
    (claim,) = _decide(second, _map(2.0)).claims
    assert claim.to_target is to_target


def test_member_keeps_clear_of_where_another_may_have_been_stopped() -> None:
    """The other has driven 0.25 m ahead, or a wall has stopped it; the member behind it waits until it reports."""
    first, second = (Member(name, k, Hull(radius_m=0.1), 1) for k, name in enumerate("ab"))
    estimate = _decide(second, _map(1.5))
    second.report(estimate, _decision(estimate))
    _decide(first, _map(1.0))
    _send(second, first)
    merged = _decide(first, _map(1.0))
    (robot,) = merged.moving
    assert robot.xy.tolist() == [1.75, 1.0]
    assert (robot.xy + robot.velocity).tolist() == [1.5, 1.0]
    avoidance = Avoidance()
    assert avoidance.checked(merged, Action.FORWARD) is Action.WAIT
    driven = replace(merged, moving=(replace(robot, velocity=np.zeros(2)),))
    assert avoidance.checked(driven, Action.FORWARD) is Action.FORWARD


def test_member_silent_robot_is_nowhere_but_still_bound_for_its_goal() -> None:
    first, second = (Member(name, k, Hull(radius_m=0.1), 10) for k, name in enumerate("ab"))
    estimate = _decide(first, _map(1.0))
    first.report(estimate, _decision(estimate))
    _send(first, second)
    merged = [_decide(second, _map(2.0)) for _ in range(60)]
    assert len(merged[1].moving) == 1 and len(merged[1].claims) == 1
    assert merged[10].moving == () and len(merged[10].claims) == 1
    assert merged[-1].claims == ()


def test_member_robot_that_turns_in_its_place_stands() -> None:
    """Its base moves by 2 cm with each turn."""
    first, second = (Member(name, k, Hull(radius_m=0.1), 10) for k, name in enumerate("ab"))
    for turn in range(5):
        estimate = _map(1.0)
        estimate.pose[:] = 1.0 + 0.02 * (turn % 2), 1.0, 0.17 * turn
        estimate = _decide(first, estimate)
        first.report(estimate, _decision(estimate))
    _send(first, second)
    (robot,) = _decide(second, _map(2.0)).moving
    assert robot.stood_s == 4.0


def test_member_leaves_the_floor_at_the_feet_of_another_to_it() -> None:
    first, second = (Member(name, k, Hull(radius_m=0.1), 10) for k, name in enumerate("ab"))
    estimate = _decide(first, _map(1.0, seen=False))
    first.report(estimate, _decision(estimate))
    _send(first, second)
    own = _map(2.0, seen=False)
    merged = _decide(second, own)
    centres = merged.frame.centres(merged.explored)
    assert 0.3 < np.hypot(*(centres - (1.0, 1.0)).T).max() <= 0.4
    assert not own.explored.any()


def test_member_merged_map_is_the_same_again() -> None:
    """It is no decision: nothing is counted, read or written by it."""
    first, second = (Member(name, k, Hull(radius_m=0.1), 10) for k, name in enumerate("ab"))
    estimate = _decide(first, _map(1.0))
    first.report(estimate, _decision(estimate))
    _send(first, second)
    merged = _decide(second, _map(2.0))
    for _ in range(60):
        again = second.merged(_map(2.0))
    assert np.array_equal(again.explored, merged.explored)
    assert len(again.moving) == len(merged.moving) == 1 and len(again.claims) == 1


def _start(x: float) -> Status:
    return Status(0, np.array([x, 1.0, 0.0]), np.array([x, 1.0]), 0.1, 0)


def test_member_places_of_others_follow_from_starts_and_reports() -> None:
    """A robot that has not reported its last decision has two places, both ends of a step."""
    first, second = (Member(name, k, Hull(radius_m=0.1), 10) for k, name in enumerate("ab"))
    first.begin_together({"b": _start(2.0)})
    second.begin_together({"a": _start(1.0)})
    assert second.places is not None and second.places.tolist() == [[1.0, 1.0, 0.1]]
    for member, x, other in ((first, 1.0, second), (second, 2.0, first)):
        estimate = _decide(member, _map(x))
        member.report(estimate, _decision(estimate))
        _send(member, other)
        if other is second:
            assert member.places is not None
            assert member.places.tolist() == [[2.0, 1.0, 0.1], [2.25, 1.0, 0.1]]
    assert second.places is not None and second.places.tolist() == [[1.25, 1.0, 0.1]]


def test_member_places_are_unknown_out_of_reach_and_without_starts() -> None:
    members = [Member(name, k, Hull(radius_m=0.1), 10) for k, name in enumerate("ab")]
    members[0].begin_together({"b": _start(2.0)})
    known = []
    for _ in range(3):
        known.append([member.places is not None for member in members])
        members[0].begin(_map(1.0))
    # Without a report of its second decision the other may be anywhere.
    assert known == [[True, False], [True, False], [False, False]]
