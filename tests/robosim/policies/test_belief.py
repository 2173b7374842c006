"""The belief over the target's position."""

import numpy as np
import pytest

from robosim.policies.belief import BeliefConfig, TargetBelief
from robosim.policies.likelihood import Likelihood
from robosim.policies.sightlines import bent_origins, in_sight, knowledge
from robosim.radio.measurement import Measurement
from slam.grid import GridFrame, MapEstimate
from wireless.paths import LinkState

FRIIS_1M_DB = 20 * np.log10(299_792_458 / 28e9 / (4 * np.pi))


def estimate(obstacle: np.ndarray | None = None, known: bool = True) -> MapEstimate:
    """A map of 12 m by 12 m around the origin; free but for obstacles if known."""
    frame = GridFrame(origin_xy=(-6.0, -6.0), resolution_m=0.05, shape=(240, 240))
    probability = np.full(frame.shape, 0.1 if known else 0.5, np.float32)
    if obstacle is not None:
        probability[obstacle] = 0.9
    return MapEstimate(
        frame=frame,
        obstacle_probability=probability,
        explored=np.full(frame.shape, known),
        blocked=np.zeros(frame.shape, bool),
        pose=np.zeros(3),
    )


def wall(x0: float, x1: float, y0: float, y1: float) -> np.ndarray:
    """Cells of a box [m]."""
    at = np.arange(240) * 0.05 - 6 + 0.025
    return ((at >= y0) & (at <= y1))[:, None] & ((at >= x0) & (at <= x1))[None]


def measurement(pose, aoa, aod, distance_m, state, loss_db=0.0) -> Measurement:
    """One path that lost as much as a free wave of that length, and more."""
    return Measurement(
        pose=np.array([*pose, 0.0]),
        aoa_rad=np.array([aoa]),
        aod_rad=np.array([aod]),
        snr_db=np.array([40.0]),
        gain_db=np.array([FRIIS_1M_DB - 20 * np.log10(distance_m) - loss_db]),
        delay_s=np.zeros(1),
        probability=np.eye(4)[state],
    )


def to(pose, target):
    return float(np.arctan2(target[1] - pose[1], target[0] - pose[0]))


def test_one_measurement_in_sight_gives_direction_and_distance():
    """The peak lies within 0.3 m of the target, though the map is unknown."""
    target = np.array([3.0, 2.0])
    belief = TargetBelief(np.zeros(2))
    aoa = to((0, 0), target)
    belief.add(measurement((0, 0), aoa, aoa + np.pi, np.hypot(*target), LinkState.LOS), estimate(known=False))
    place, mass = belief.peak()
    assert np.hypot(*(place - target)) < 0.3
    assert mass > 0.01


def test_a_line_of_sight_that_fades_for_some_decisions_is_not_another_place():
    """Five measurements in sight, then three of which a person takes 15 dB: the peak stays within 0.3 m."""
    target, belief = np.array([3.0, 2.0]), TargetBelief(np.zeros(2))
    for k in range(8):
        place = np.array([0.2 * k, 0.0])
        aoa, distance_m = to(place, target), np.hypot(*(target - place))
        loss_db = 15.0 if k >= 5 else 0.0
        belief.add(
            measurement(place, aoa, aoa + np.pi, distance_m, LinkState.LOS, loss_db), estimate(known=False)
        )
    assert np.hypot(*(belief.peak()[0] - target)) < 0.3


def test_in_a_large_building_the_grid_grows():
    """A target 57 m from the start, beyond the first grid of 30 m: within 1 m of it after 50 m towards it."""
    target, belief, first = np.array([57.0, 3.0]), TargetBelief(np.zeros(2)), TargetBelief(np.zeros(2)).frame
    for x in np.linspace(0, 50, 40):
        aoa, away_m = to((x, 0), target), np.hypot(target[0] - x, target[1])
        map_ = MapEstimate(**{**vars(estimate(known=False)), "pose": np.array([x, 0.0, 0.0])})
        belief.add(measurement((x, 0), aoa, aoa + np.pi, away_m, LinkState.LOS), map_)
    place, mass = belief.peak()
    assert np.hypot(*(place - target)) < 1.0
    assert mass > 0.3
    assert belief.probability().shape == belief.frame.shape
    offset = first.to_cells(np.array(belief.frame.origin_xy))
    assert offset == pytest.approx(np.round(offset), abs=1e-6)
    belief.rule_out(place, 0.5, strength=9.0)
    assert np.hypot(*(belief.peak()[0] - place)) > 0.5


def test_measurements_concentrate_the_belief():
    """Seven of them over 2 m: within 0.2 m, with more than 0.6 of the probability."""
    target, belief = np.array([1.0, 4.0]), TargetBelief(np.zeros(2))
    for x in np.linspace(-1, 1, 7):
        aoa = to((x, 0), target)
        belief.add(
            measurement((x, 0), aoa, aoa + np.pi, np.hypot(target[0] - x, target[1]), LinkState.LOS),
            estimate(known=False),
        )
    place, mass = belief.peak()
    assert np.hypot(*(place - target)) < 0.2
    assert mass > 0.6
    assert belief.probability().sum() == pytest.approx(1, abs=1e-4)


def test_a_bent_wave_leads_around_the_corner():
    """A wall ends at (2, 0); the target is behind it, out of sight: arrival and departure meet at the wall's end.

    Several places along the wall narrow the belief to within 0.6 m, none of it in sight.
    """
    blocks = estimate(wall(2.0, 2.2, 0.0, 6.0))
    corner, target = np.array([2.05, -0.05]), np.array([4.0, 1.5])
    belief = TargetBelief(np.zeros(2))
    for y in np.linspace(0.6, 2.6, 9):
        pose, leg = np.array([0.5, y]), np.hypot(*(target - corner))
        length = leg + np.hypot(*(corner - pose))
        belief.add(
            measurement(
                pose, to(pose, corner), to(target, corner), length, LinkState.FIRST_ORDER, loss_db=15
            ),
            blocks,
        )
    place, _ = belief.peak()
    off = to(corner, place) - to(corner, target)
    assert abs(off) < np.deg2rad(6)
    p, centres = belief.probability(), belief.centres
    assert p[centres[..., 0] < 1.8].sum() < 0.2


def test_out_of_sight_cells_in_sight_lose_probability():
    """An outage in a known hall of 12 m by 12 m: cells in sight retain 2 % of their probability."""
    config = BeliefConfig(weight=1.0, doubt=0.0, beyond_m=1e6, look_m=0.0)
    belief = TargetBelief(np.zeros(2), config)
    before = belief.probability()
    nothing = Measurement(np.zeros(3), *(np.zeros(0) for _ in range(5)), np.eye(4)[LinkState.OUTAGE])
    belief.add(nothing, estimate())
    ratio = belief.probability() / before
    inside = np.abs(belief.centres).max(axis=-1) < 5.5
    outside = np.abs(belief.centres).max(axis=-1) > 6.5
    assert ratio[inside].max() / ratio[outside].min() == pytest.approx(0.02, rel=1e-3)


def silence(x: float, y: float) -> Measurement:
    """A place where nothing is received."""
    return Measurement(np.array([x, y, 0.0]), *(np.zeros(0) for _ in range(5)), np.eye(4)[LinkState.OUTAGE])


SILENCE = BeliefConfig(silence=True, beyond_m=1e6, look_m=0.0)


def share_near(belief: TargetBelief, place: tuple[float, float], radius_m: float) -> float:
    """Probability within a distance of a place [m]."""
    is_near = np.hypot(*(belief.centres - place).transpose(2, 0, 1)) < radius_m
    return float(belief.probability()[is_near].sum())


def test_silence_excludes_as_the_place_that_excludes_most():
    """Two silent places exclude as much as one where cells are as far from both; nearer cells lose more."""
    shares = []
    for places in ([-3.0], [-3.0, 3.0]):
        belief = TargetBelief(np.zeros(2), SILENCE)
        for x in places:
            belief.add(silence(x, 0.0), estimate(known=False))
        p, (row, column) = belief.probability(), belief.frame.index(np.zeros(2))
        shares.append(p[row + 10 :: 10, column] / p[-1, column])
    assert shares[1] == pytest.approx(shares[0], rel=2e-3)
    assert shares[0][0] < 0.5
    assert (np.diff(shares[0]) > 0).all()


def test_a_reception_counts_against_silence_around_it():
    """Silence at six places 4 m around, then a reception there: more than 5 times the belief within 3 m."""
    map_, belief = estimate(known=False), TargetBelief(np.zeros(2), SILENCE)
    for turn in range(6):
        belief.add(silence(4 * np.cos(turn), 4 * np.sin(turn)), map_)
    before = share_near(belief, (0, 0), 3.0)
    belief.add(measurement((0, 0), 1.0, 2.0, 6.0, LinkState.HIGHER_ORDER, loss_db=30), map_)
    assert share_near(belief, (0, 0), 3.0) > 5 * before


def test_estimated_paths_in_an_outage_are_silence():
    """A path that the link state calls noise excludes as much as no path."""
    silent, noise = (TargetBelief(np.zeros(2), SILENCE) for _ in range(2))
    silent.add(silence(0, 0), estimate(known=False))
    noise.add(measurement((0, 0), 1.0, 2.0, 4.0, LinkState.OUTAGE, loss_db=30), estimate(known=False))
    assert share_near(noise, (0, 0), 3.0) == pytest.approx(share_near(silent, (0, 0), 3.0), rel=1e-3)
    assert share_near(noise, (0, 0), 3.0) < 0.8 * share_near(TargetBelief(np.zeros(2), SILENCE), (0, 0), 3.0)


def test_a_searched_place_loses_probability():
    belief = TargetBelief(np.zeros(2))
    aoa = 0.3
    belief.add(measurement((0, 0), aoa, aoa + np.pi, 3.0, LinkState.LOS), estimate(known=False))
    place, mass = belief.peak()
    belief.rule_out(place, 0.5)
    after, less = belief.peak()
    assert less < mass
    assert np.hypot(*(after - place)) > 0.2


def test_later_measurements_correct_a_wrong_one():
    """Two that point to other places, then six right ones."""
    target, belief = np.array([3.0, 0.5]), TargetBelief(np.zeros(2))
    for i, y in enumerate(np.linspace(0, 2, 8)):
        aoa = 2.5 if i < 2 else to((0, y), target)
        distance = np.hypot(target[0], target[1] - y)
        belief.add(measurement((0, y), aoa, aoa + np.pi, distance, LinkState.LOS), estimate(known=False))
    assert np.hypot(*(belief.peak()[0] - target)) < 0.3


def test_seen_cells_and_the_trajectory_hold_no_target():
    """Looking along x in a known hall: cells ahead within 1.2 m and around the robot are a tenth as likely as others.

    Without a camera only those around the robot are.
    """
    nothing = Measurement(np.zeros(3), *(np.zeros(0) for _ in range(5)), np.eye(4)[LinkState.OUTAGE])
    for look_m, ahead_ratio in ((1.2, 0.1), (0.0, 1.0)):
        belief = TargetBelief(np.zeros(2), BeliefConfig(look_m=look_m))
        belief.add(nothing, estimate())
        p, at = (
            belief.probability(),
            lambda x, y, b=belief: tuple(int(i) for i in b.frame.index(np.array([x, y]))),
        )
        other = p[at(0.0, 1.0)]
        assert p[at(0.8, 0.0)] / other == pytest.approx(ahead_ratio, rel=1e-3)
        assert p[at(0.0, 0.0)] / other == pytest.approx(0.1, rel=1e-3)
        assert p[at(-0.8, 0.0)] / other == pytest.approx(1.0, rel=1e-3)


def test_places_outside_the_explored_area_are_less_likely():
    """The prior: e times less 5 m outside of a hall that was seen, and never below a hundredth."""
    nothing = Measurement(np.zeros(3), *(np.zeros(0) for _ in range(5)), np.eye(4)[LinkState.OUTAGE])
    belief = TargetBelief(np.zeros(2), BeliefConfig(weight=0.0, look_m=0.0))
    belief.add(nothing, estimate())
    p = belief.probability()
    at = [tuple(int(i) for i in belief.frame.index(np.array([x, 0.0]))) for x in (5.0, 11.0, 29.0)]
    inside, near, far = (p[cell] for cell in at)
    assert near / inside == pytest.approx(np.exp(-1), rel=0.05)
    assert far / inside == pytest.approx(0.01, rel=0.05)


def two_rooms() -> np.ndarray:
    """A wall across a hall at x = 2 m with one door, at y = -3 m."""
    return wall(2.0, 2.2, -6.0, 6.0) & ~wall(1.9, 2.3, -3.5, -2.5)


def test_a_wave_of_higher_order_leads_through_the_door():
    """It arrives from the door's side. All of the room behind the door gains on the free half behind the robot.

    With an arrival from the other side, the room loses; without routes, neither.
    """
    blocks, robot, door = estimate(two_rooms()), np.array([0.5, -1.0]), np.array([2.1, -3.0])
    behind, back = np.array([4.0, -1.0]), np.array([-8.0, 2.0])
    shares = []
    for routes, turned in ((True, 0.0), (True, np.pi), (False, 0.0)):
        belief = TargetBelief(robot, BeliefConfig(routes=routes, beyond_m=1e6))
        aoa, aod = to(robot, door) + turned, to(behind, door) + turned
        belief.add(measurement(robot, aoa, aod, 20.0, LinkState.HIGHER_ORDER), blocks)
        p = belief.probability()
        there, here = (p[tuple(int(i) for i in belief.frame.index(place))] for place in (behind, back))
        shares.append(there / here)
    right, wrong, without = shares
    assert right > 2.5 * without
    assert wrong < 0.7 * without


def around_the_corner(**config) -> tuple[TargetBelief, TargetBelief]:
    """Beliefs from one bent wave, with the right departure and with one wrong by 2 rad."""
    blocks = estimate(wall(2.0, 2.2, 0.0, 6.0))
    pose, corner, target = np.array([0.5, 1.0]), np.array([2.05, -0.05]), np.array([4.0, 1.5])
    length = np.hypot(*(target - corner)) + np.hypot(*(corner - pose))
    beliefs = (
        TargetBelief(np.zeros(2), BeliefConfig(**config)),
        TargetBelief(np.zeros(2), BeliefConfig(**config)),
    )
    for belief, wrong in zip(beliefs, (0.0, 2.0), strict=True):
        aod = to(target, corner) + wrong
        belief.add(
            measurement(pose, to(pose, corner), aod, length, LinkState.FIRST_ORDER, loss_db=15), blocks
        )
    return beliefs


def test_without_departures_none_is_used_and_the_target_stays_likely():
    """The same for any departure, and wider than with it; the target's place is likelier than most by five times."""
    right, wrong = around_the_corner()
    assert not np.allclose(right.probability(), wrong.probability())
    with_p, p = right.probability(), around_the_corner(departures=False)[0].probability()
    assert np.array_equal(p, around_the_corner(departures=False)[1].probability())
    assert np.count_nonzero(p > p.max() / 10) > 1.5 * np.count_nonzero(with_p > with_p.max() / 10)
    ix, iy = np.floor(right.frame.to_cells(np.array([4.0, 1.5]))).astype(int)
    assert p[iy, ix] > 5 * np.median(p)


def test_without_memory_the_last_measurement_is_all():
    """Two places: after both the belief is that of the second alone; with memory it is not."""
    target = np.array([4.0, -1.0])
    for remembers in (False, True):
        config = BeliefConfig(remembers=remembers)
        both, second = TargetBelief(np.zeros(2), config), TargetBelief(np.zeros(2), config)
        for belief, places in ((both, [(-2.0, -2.0), (0.0, 2.0)]), (second, [(0.0, 2.0)])):
            for at in places:
                belief.add(
                    measurement(at, to(at, target), 0.0, np.hypot(*(target - at)), LinkState.LOS),
                    estimate(known=False),
                )
        assert np.array_equal(both.probability(), second.probability()) != remembers


def test_measurements_from_one_place_count_once():
    belief, one = TargetBelief(np.zeros(2)), measurement((0, 0), 0.3, 3.4, 3.0, LinkState.LOS)
    assert belief.add(one, estimate())
    before = belief.probability()
    assert not belief.add(one, estimate())
    assert np.array_equal(belief.probability(), before)


def test_sight_ends_at_obstacles_and_is_unsure_beyond_the_map():
    """Behind a wall nothing is in sight; through the open side all of the map surely, beyond it possibly."""
    known = knowledge(estimate(wall(1.0, 1.1, -6.0, 6.0)), next_to_m=0.2)
    onto = GridFrame(origin_xy=(-10.0, -10.0), resolution_m=0.2, shape=(100, 100))
    surely, possibly = (
        in_sight(known, np.zeros(2), onto, 9.0, through_unknown=through) for through in (False, True)
    )
    x, y = np.moveaxis(onto.to_points(np.stack(np.meshgrid(np.arange(100), np.arange(100)), -1) + 0.5), -1, 0)
    assert not possibly[(x > 1.3) & (np.abs(y) < 5)].any()
    inside = (x < 0.8) & (x > -5.8) & (np.abs(y) < 5.8) & (np.hypot(x, y) < 8.5)
    assert surely[inside].mean() > 0.99
    beyond = (x < -6.2) & (np.hypot(x, y) < 8.5) & (np.abs(y) < 2)
    assert possibly[beyond].mean() > 0.99
    assert not surely[beyond].any()


def test_in_sight_follows_rays_while_they_stay_within():
    """Inside a half plane around the place nothing changes; beyond it, and behind a gap, nothing is seen."""
    known = knowledge(estimate(), next_to_m=0.2)
    onto = GridFrame(origin_xy=(-10.0, -10.0), resolution_m=0.2, shape=(100, 100))
    within = np.broadcast_to(np.arange(100) >= 45, onto.shape)
    everywhere = in_sight(known, np.zeros(2), onto, 9.0, through_unknown=True)
    ahead = in_sight(known, np.zeros(2), onto, 9.0, through_unknown=True, within=within)
    assert np.array_equal(ahead, everywhere & within)
    gap = in_sight(
        known,
        np.zeros(2),
        onto,
        9.0,
        through_unknown=True,
        within=np.broadcast_to(np.arange(100) != 60, onto.shape),
    )
    assert everywhere[50, 61:90].all() and gap[50, :60].any() and not gap[:, 60:].any()


@pytest.mark.parametrize("arrival_deg", [2.5, 30.0])
def test_density_in_line_of_sight_is_that_of_all_cells(arrival_deg):
    """Density of a bearing and a power by its formula in all cells, also far from the beam and behind walls."""
    belief = TargetBelief(np.zeros(2), BeliefConfig(half_side_m=8.0))
    map_ = estimate(wall(2.0, 2.1, 0.5, 6.0))
    measured = measurement((0.3, -0.2), 0.4, 0.0, 5.0, LinkState.LOS)
    offset = belief.centres - measured.pose[:2]
    distance = np.hypot(*offset.transpose(2, 0, 1))
    survey = belief.survey(map_)
    likelihood = Likelihood(
        measured, survey, (offset[:1, :, 0], offset[:, :1, 1]), distance,
        frequency_hz=28e9, departures=True, routes=True,
    )  # fmt: skip
    density = likelihood._straight(np.deg2rad(arrival_deg), 2.5, 8.0)
    near = np.maximum(distance.astype(np.float32), 0.1)
    lateral = offset[..., 1] * np.cos(0.4) - offset[..., 0] * np.sin(0.4)
    ahead = offset[..., 0] * np.cos(0.4) + offset[..., 1] * np.sin(0.4)
    power = 20 * np.log10(near / 5.0) / np.hypot(2.5, 8.7 * 0.1 / near)
    square = (lateral / np.hypot(np.deg2rad(arrival_deg) * near, 0.1)) ** 2 + power**2
    expected = np.where(ahead >= -0.2, np.exp(-0.5 * square), 0.0)
    possibly = in_sight(survey.known, measured.pose[:2], belief.frame, 8.0, through_unknown=True)
    np.testing.assert_allclose(density, np.where(possibly, 1.0, 0.05) * expected, rtol=2e-3, atol=1e-38)


def test_a_wave_bends_only_where_there_is_something():
    """In a known, empty hall there is nothing that could have bent it: no weight anywhere inside."""
    known = knowledge(estimate(), next_to_m=0.2)
    onto = GridFrame(origin_xy=(-5.0, -5.0), resolution_m=0.2, shape=(50, 50))
    assert not bent_origins(known, np.zeros(2), 0.3, 1.0, 0.05, 5.0, onto).any()
