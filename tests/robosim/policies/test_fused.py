"""The policy `fused`."""

from dataclasses import replace

import numpy as np
import pytest

from robosim.agent import check_weights
from robosim.episode_config import EpisodeConfig
from robosim.navigation import make_navigator
from robosim.policies.belief import TargetBelief
from robosim.policies.estimates import Estimates
from robosim.policies.fused import Fused
from robosim.policies.goals import PolicyContext
from robosim.policies.reason import GoalKind
from robosim.radio.measurement import Measurement
from robosim.robot.robots import RobotConfig
from robosim.simulator import Observation, SimulatorConfig
from slam.graph.landmarks import Transmitter
from slam.grid import Claim, MapEstimate
from tests.robosim.policies.test_belief import FRIIS_1M_DB, estimate, measurement, to, wall
from wireless.paths import LinkState

TARGET = np.array([3.0, 2.0])
EVERYWHERE = estimate()


@pytest.fixture
def fused() -> Fused:
    return Fused(make_navigator(SimulatorConfig()).explorer)


def at(place, state: LinkState, map_: MapEstimate = EVERYWHERE, seen=None, loss_db=0.0):
    """Observation and estimates with a direct path to the target."""
    pose = np.array([*place, 0.0])
    map_ = MapEstimate(**{**vars(map_), "pose": pose})
    toward = to(place, TARGET)
    measured: Measurement = measurement(
        place, toward, toward + np.pi, np.hypot(*(TARGET - place)), state, loss_db
    )
    sensed = Observation(np.zeros((0, 0, 3), np.uint8), np.zeros((0, 0)), np.zeros(3), target=seen)
    return sensed, Estimates(map_, measured)


def test_in_line_of_sight_the_direction_counts_and_not_the_power(fused):
    """6 dB too weak, as if twice as far away: the goal still lies 0.6 m ahead towards the target."""
    goal = fused.goal(*at((0.0, 0.0), LinkState.LOS, loss_db=6.0))
    assert goal == pytest.approx(0.6 * TARGET / np.hypot(*TARGET))


def test_a_seen_target_precedes_the_radio(fused):
    """Seen 1 m ahead and 0.5 m to the left, and remembered when it is out of the picture."""
    assert fused.goal(*at((0.0, 0.0), LinkState.LOS, seen=np.array([1.0, 0.5]))) == pytest.approx([1.0, 0.5])
    assert fused.goal(*at((0.5, 0.0), LinkState.HIGHER_ORDER)) == pytest.approx([1.0, 0.5])


def test_a_stuck_robot_follows_the_belief_instead_of_the_arrival(fused):
    """0.6 m along the arrival for a while, then within 0.4 m of the target."""
    for x in np.linspace(-3.0, -0.6, 5):
        fused.goal(*at((x, 0.0), LinkState.LOS))
    goals = np.array([fused.goal(*at((0.0, 0.0), LinkState.LOS)) for _ in range(31)])
    assert np.hypot(*goals[5:25].T) == pytest.approx(0.6)
    assert goals[-1] == pytest.approx(TARGET, abs=0.4)


def test_out_of_sight_it_goes_where_the_belief_has_gathered(fused):
    """Line of sight along a wall, and none behind it: the place is remembered."""
    map_ = estimate(wall(-0.2, 0.0, 0.5, 3.0))
    for x in np.linspace(2.0, 0.2, 7):
        fused.goal(*at((x, 0.0), LinkState.LOS, map_))
    hidden = at((-1.0, 1.5), LinkState.HIGHER_ORDER, map_, loss_db=30.0)
    for _ in range(7):
        goal = fused.goal(*hidden)
    assert goal == pytest.approx(TARGET, abs=0.4)


def test_out_of_sight_it_goes_where_the_graph_has_found_the_target(fused):
    """Within 0.1 m of the graph's position, to which one measurement of higher order adds nothing."""
    sensed, estimated = at((-1.0, 1.5), LinkState.HIGHER_ORDER, loss_db=30.0)
    found = Transmitter(xy=TARGET, covariance=0.01 * np.eye(2), sightings=9)
    estimated = replace(estimated, locate_transmitters=lambda: {"target": found})
    assert fused.goal(sensed, estimated) == pytest.approx(TARGET, abs=0.1)


def test_an_empty_position_of_the_graph_is_given_up(fused):
    """The robot stands there: its goal is 1 m away or more before it has decided 60 times."""
    sensed, estimated = at((0.0, 0.0), LinkState.HIGHER_ORDER, loss_db=30.0)
    found = Transmitter(xy=np.zeros(2), covariance=0.01 * np.eye(2), sightings=9)
    estimated = replace(estimated, locate_transmitters=lambda: {"target": found})
    goals = np.array([fused.goal(sensed, estimated) for _ in range(60)])
    assert np.hypot(*goals[-1]) > 1.0


def test_a_place_that_the_robot_comes_no_nearer_to_is_ruled_out(fused, monkeypatch):
    """Circling 2 m around a place 4 m away, to which the belief holds: 60 decisions after the first, the nearest."""
    ruled_out = []
    monkeypatch.setattr(TargetBelief, "peak", lambda _: (TARGET, 0.9))
    monkeypatch.setattr(TargetBelief, "rule_out", lambda _, *place: ruled_out.append(place))
    for decision, angle in enumerate(0.125 * np.arange(66)):
        place = (2.0 * np.cos(angle) - 1.0, 2.0 * np.sin(angle) + 2.0)
        fused.goal(*at(place, LinkState.HIGHER_ORDER))
        assert bool(ruled_out) is (decision >= 60)
    assert ruled_out[0] == (pytest.approx(TARGET), 0.6)


def test_a_free_wave_of_a_metre_has_the_assumed_power():
    """61.4 dB at 28 GHz (Friis)."""
    assert pytest.approx(-61.4, abs=0.05) == FRIIS_1M_DB


def test_a_policy_is_given_the_robot():
    """Of 0.3 m radius, with calibrated motions of its actions."""
    robots = []

    def policy(context: PolicyContext) -> Fused:
        robots.append(context.robot)
        return Fused(context.explorer, context.fused, context.robot)

    simulator = SimulatorConfig(robot=RobotConfig(radius_m=0.3))
    check_weights(EpisodeConfig(goal=policy, mapper="classical", explorer="gain", simulator=simulator))
    assert robots[0].hull.radius_m == 0.3 and None not in robots[0].motions


def _in_team(place, state: LinkState, *claims: Claim, **options):
    sensed, estimated = at(place, state, **options)
    return sensed, replace(estimated, map=replace(estimated.map, claims=claims))


@pytest.mark.parametrize("to_target", [False, True])
def test_in_a_team_one_robot_follows_arrivals_of_first_order_at_first(fused, to_target):
    """An arrival along x; another robot is bound for a place behind, and follows an arrival or not."""
    behind = Claim(np.array([-1.0, -1.0]), 0.6, to_target)
    fused.goal(*_in_team((0.0, 0.0), LinkState.FIRST_ORDER, behind))
    assert (fused.reason.kind is GoalKind.ARRIVAL) is not to_target


@pytest.mark.parametrize(
    ("claim", "goes"),
    [
        (Claim(TARGET, 3.0, True), False),
        (Claim(TARGET - 1.0, 2.0, True), False),
        (Claim(TARGET, 5.0, True), True),
        (Claim(TARGET, 3.0), True),
    ],
)
def test_in_a_team_the_nearest_robot_that_seeks_the_target_goes_where_it_is_believed(fused, claim, goes):
    """The robot is 4.03 m from the target, which the graph has located."""
    sensed, estimated = _in_team((-1.0, 1.5), LinkState.HIGHER_ORDER, claim, loss_db=30.0)
    transmitter = Transmitter(xy=TARGET, covariance=0.01 * np.eye(2), sightings=9)
    fused.goal(sensed, replace(estimated, locate_transmitters=lambda: {"target": transmitter}))
    assert ("of the belief lies within" in fused.reason.because) is goes
