"""Sightings in the graph, and landmarks of a radio, compared with another solver and with ground truth."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from slam.graph.landmarks import Landmarks
from slam.graph.least_squares import Constraint, Sighting
from slam.graph.pose_graph import PoseGraph
from slam.poses import between, compose, wrap
from slam.sensing.bearings import Bearing

STEP = np.diag([0.01, 0.01, math.radians(0.5)]) ** 2
SURE = np.zeros((3, 3))
#: Shared errors of directions on a stretch [deg], and of distances of a place.
SHARED = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.05)]


def _walk(rng: np.random.Generator, steps: int, noise: float = 1.0) -> tuple[PoseGraph, np.ndarray]:
    """A winding route with noisy steps of a metre, and the true poses."""
    graph, true = PoseGraph(np.zeros(3)), [np.zeros(3)]
    for k in range(steps):
        move = np.array([1.0, 0.0, 0.3 * math.cos(0.4 * k)])
        measured = move + noise * rng.multivariate_normal(np.zeros(3), STEP)
        true.append(compose(true[-1], move))
        graph.add(compose(graph.poses[-1], measured))
        graph.hold(Constraint(first=k, second=k + 1, pose=measured, covariance=STEP))
    return graph, np.array(true)


def _along(graph: PoseGraph, true: np.ndarray, estimate: PoseGraph) -> Iterator[tuple[int, np.ndarray]]:
    """Numbers and true poses of a walk, whose steps are added to an estimate one by one."""
    for k, pose in enumerate(true):
        if k:
            estimate.add(compose(estimate.poses[-1], graph.constraints[k - 1].pose))
            estimate.hold(graph.constraints[k - 1])
        yield k, pose


def _bearing(
    pose: np.ndarray, place: np.ndarray, rng: np.random.Generator, source="a", spread=0.05, **more
) -> Bearing:
    away = place - pose[:2]
    return Bearing(
        source=source,
        bearing_rad=wrap(math.atan2(away[1], away[0]) - pose[2] + rng.normal(0, math.radians(0.4))),
        sigma_rad=math.radians(0.4),
        range_m=float(np.hypot(*away) * np.exp(rng.normal(0, spread))),
        sigma_log_range=0.05,
        **more,
    )


def _seen_all_along(
    seed: int, shared_rad: float = 0.0, shared_range: float = 0.0, is_modelled: bool = True
) -> tuple[PoseGraph, np.ndarray, np.ndarray]:
    """A walk past two places, seen from next to every pose; the second's distance is compared with the first's.

    Directions of one place from five poses in a row share an error, all distances of the first another; the
    sightings include these errors, or not.
    """
    rng = np.random.default_rng(seed)
    graph, true = _walk(rng, 25)
    places = np.array([[8.0, 6.0], [18.0, -5.0]])
    for place in places:
        graph.add_place(place + rng.normal(0, 0.5, 2))
    alike, longer = rng.normal(0, shared_rad, (2, len(true))), np.exp(rng.normal(0, shared_range))
    for k, pose in enumerate(true):
        at = np.array([0.2, -0.1, 0.4])
        seen_from = compose(pose, at)
        gaps = np.hypot(*(places - seen_from[:2]).T)
        for number, place in enumerate(places):
            bearing = _bearing(seen_from, place, rng)
            beyond = number == 1
            graph.see(
                Sighting(
                    pose=k,
                    at=at,
                    place=number,
                    bearing_rad=wrap(bearing.bearing_rad + alike[number, k // 5]),
                    sigma_rad=bearing.sigma_rad,
                    stretch=k // 5 * 2 + number,
                    shared_rad=shared_rad if is_modelled else 0.0,
                    range_m=float(gaps[1] - gaps[0] + rng.normal(0, 0.05))
                    if beyond
                    else longer * bearing.range_m,
                    shared_range=shared_range if is_modelled and not beyond else 0.0,
                    sigma_range=0.05 if beyond else bearing.sigma_log_range,
                    beyond=0 if beyond else None,
                )
            )
    return graph, true, places


@pytest.mark.parametrize(("shared_deg", "shared_range"), SHARED)
def test_it_finds_what_another_solver_finds(shared_deg: float, shared_range: float) -> None:
    """SciPy's trust region on the same squares with the kernel as a loss: poses and places within 3e-3."""
    graph, _, _ = _seen_all_along(0, math.radians(shared_deg), shared_range)
    graph.solve()
    count = len(graph.poses)
    root = np.linalg.cholesky(np.linalg.inv(STEP)).T

    def errors(values: np.ndarray) -> np.ndarray:
        poses = np.vstack([np.zeros(3), values[: 3 * count - 3].reshape(-1, 3)])
        places = values[3 * count - 3 : 3 * count + 1].reshape(-1, 2)
        scale, shared = values[3 * count + 1], values[3 * count + 2 :]
        residuals = [*shared, scale / math.sqrt(1 + scale**2 / 10.83)]
        for one in graph.constraints:
            off = between(poses[one.first], poses[one.second]) - one.pose
            residuals.extend(root @ [off[0], off[1], wrap(float(off[2]))])
        for one in graph.sightings:
            pose = compose(poses[one.pose], one.at)
            away = places[one.place] - pose[:2]
            turn = wrap(math.atan2(away[1], away[0]) - pose[2] - one.bearing_rad)
            turn += one.shared_rad * shared[one.stretch]
            gap = np.hypot(*away)
            if one.beyond is None:
                far = math.log(gap / one.range_m) + one.shared_range * scale
            else:
                far = gap - np.hypot(*(places[one.beyond] - pose[:2])) - one.range_m
            # Geman and McClure's kernel, as a residual whose square it is.
            for value in (turn / one.sigma_rad, far / one.sigma_range):
                residuals.append(value / math.sqrt(1 + value**2 / 10.83))
        return np.array(residuals)

    start = np.concatenate([np.array(graph.poses[1:]).ravel(), np.array(graph.places).ravel()])
    shared = np.zeros(2 + max(one.stretch for one in graph.sightings))
    judge = least_squares(errors, np.concatenate([start, shared]), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    assert np.abs(judge.x[: len(start)] - start).max() < 3e-3


def test_directions_that_err_alike_are_not_counted_as_many() -> None:
    """With an error of 2 degrees that five in a row share, poses are better than without a shared error."""
    off: dict[bool, list[float]] = {True: [], False: []}
    for seed in range(30):
        for is_modelled, found in off.items():
            graph, true, _ = _seen_all_along(seed, math.radians(2.0), is_modelled=is_modelled)
            graph.solve()
            found.extend(np.hypot(*(np.array(graph.poses) - true)[:, :2].T))
    assert np.median(off[True]) < 0.8 * np.median(off[False])


def test_distances_that_are_wrong_altogether_pull_no_place() -> None:
    """All a seventh too long, as of a path off a wall: the place is as near to the truth as without distances.

    Without a shared error in the model it is a fifth farther from it, or more.
    """
    how = {"modelled": {"shared_range": 0.03}, "not modelled": {}, "without": {"sigma_range": 3.0}}
    off: dict[str, list[float]] = {name: [] for name in how}
    for seed in range(30):
        for name, changes in how.items():
            graph, _, places = _seen_all_along(seed)
            graph.sightings = [
                one if one.place else replace(one, range_m=1.15 * one.range_m, **changes)
                for one in graph.sightings
            ]
            graph.solve()
            off[name].append(np.hypot(*(graph.places[0] - places[0])))
    assert np.median(off["modelled"]) < 1.05 * np.median(off["without"])
    assert np.median(off["not modelled"]) > 1.2 * np.median(off["modelled"])


@pytest.mark.parametrize(("shared_deg", "shared_range"), SHARED)
def test_places_come_out_with_the_covariance_of_their_errors(shared_deg: float, shared_range: float) -> None:
    """Over 60 walks the mean squared error, in its covariances, is 2 for two numbers, within its own spread."""
    squares = []
    for seed in range(60):
        graph, _, places = _seen_all_along(seed, math.radians(shared_deg), shared_range)
        graph.solve()
        for number, place in enumerate(places):
            off = graph.places[number] - place
            squares.append(off @ np.linalg.solve(graph.place_covariance(number), off))
    assert np.mean(squares) == pytest.approx(2.0, abs=0.7)


def test_sources_hold_the_heading() -> None:
    """Where steps leave the heading to itself, two sources keep it: a third of the error at the end, or less."""
    with_radio, without = [], []
    for seed in range(20):
        graph, true, _ = _seen_all_along(seed)
        without.append(wrap(float(graph.poses[-1][2] - true[-1][2])))
        graph.solve()
        with_radio.append(wrap(float(graph.poses[-1][2] - true[-1][2])))
    assert np.sqrt(np.mean(np.square(with_radio))) < 0.33 * np.sqrt(np.mean(np.square(without)))


def test_wrong_sightings_are_left_out() -> None:
    """A fifth of all bearings points anywhere: poses end within 3 cm of where the rest alone puts them."""
    clean, _, _ = _seen_all_along(3)
    wrong, _, _ = _seen_all_along(3)
    rng = np.random.default_rng(1)
    rest = []
    for number, one in enumerate(wrong.sightings):
        if number % 5 == 4:
            wrong.sightings[number] = Sighting(**{**vars(one), "bearing_rad": rng.uniform(-math.pi, math.pi)})
        else:
            rest.append(clean.sightings[number])
    clean.sightings[:] = rest
    clean.solve()
    wrong.solve()
    off = np.hypot(*(np.array(wrong.poses) - np.array(clean.poses))[:, :2].T)
    assert off.max() < 0.03


def _receive(
    places: dict[str, np.ndarray], rng: np.random.Generator, *, known: bool = False
) -> tuple[PoseGraph, np.ndarray, Landmarks]:
    """A walk on which sources are in sight all along."""
    graph, true = _walk(rng, 25)
    landmarks, estimate = Landmarks(), PoseGraph(np.zeros(3))
    for _, pose in _along(graph, true, estimate):
        received = [
            _bearing(pose, place, rng, source=name, place_xy=place if known else None)
            for name, place in places.items()
        ]
        landmarks.see(estimate, np.zeros(3), SURE, received)
        estimate.solve()
    return estimate, true, landmarks


def test_a_source_in_sight_is_found() -> None:
    """Where it stands comes out within three standard deviations."""
    place = np.array([8.0, 6.0])
    graph, _, landmarks = _receive({"a": place}, np.random.default_rng(2))
    found = landmarks.transmitters(graph)["a"]
    off = found.xy - place
    assert off @ np.linalg.solve(found.covariance, off) < 9
    assert 20 < found.sightings <= 26  # strengths off by more than a tenth are left out


def test_sources_whose_places_are_known_hold_the_place_too() -> None:
    """Over 20 walks, the error at the end is a third of that of steps alone, or less, and the places do not change."""
    places = {"a": np.array([8.0, 6.0]), "b": np.array([18.0, -5.0])}
    held, blind = [], []
    for seed in range(20):
        graph, true, landmarks = _receive(places, np.random.default_rng(seed), known=True)
        for name, found in landmarks.transmitters(graph).items():
            assert np.array_equal(found.xy, places[name])
        held.append(np.hypot(*(graph.poses[-1] - true[-1])[:2]))
        alone, _ = _walk(np.random.default_rng(seed), 25)
        blind.append(np.hypot(*(alone.poses[-1] - true[-1])[:2]))
    assert np.median(held) < np.median(blind) / 3


def test_what_keeps_to_a_place_is_the_source_whatever_its_link_state() -> None:
    """Never classified as line of sight, but as strong as from its place: found; as weak as off a wall: not."""
    place = np.array([8.0, 6.0])
    for weaker, found in ((1.0, True), (3.0, False)):
        rng = np.random.default_rng(5)
        graph, true = _walk(rng, 25, noise=0.1)
        estimate, landmarks = PoseGraph(np.zeros(3)), Landmarks()
        for _, pose in _along(graph, true, estimate):
            received = _bearing(pose, place, rng, direct=0.1, spread=0.01)
            received = Bearing(**{**vars(received), "range_m": weaker * received.range_m})
            landmarks.see(estimate, np.zeros(3), SURE, [received])
        estimate.solve()
        where = landmarks.transmitters(estimate)
        assert bool(where) == found
        if found:
            assert np.hypot(*(where["a"].xy - place)) < 0.2


def _receive_falsely(place: np.ndarray, longer: float) -> tuple[PoseGraph, np.ndarray, Landmarks]:
    """A walk on which all arrivals come from one place that is no source, so much farther by their strength.

    All are classified as line of sight. Returns the graph, the poses of odometry alone, and the landmarks.
    """
    rng = np.random.default_rng(11)
    graph, true = _walk(rng, 25)
    estimate, landmarks = PoseGraph(np.zeros(3)), Landmarks()
    for _, pose in _along(graph, true, estimate):
        received = _bearing(pose, place, rng, direct=0.95, spread=0.01)
        received = Bearing(**{**vars(received), "range_m": longer * received.range_m})
        landmarks.see(estimate, np.zeros(3), SURE, [received])
        estimate.solve()
    return estimate, np.array(graph.poses), landmarks


@pytest.mark.parametrize("longer", [1.5, 3.0, 300.0])
def test_a_false_line_of_sight_moves_no_pose(longer: float) -> None:
    """Off the corner of a wall, said to be in sight with certainty: weaker than from there, so poses stay."""
    graph, before, landmarks = _receive_falsely(np.array([8.0, 6.0]), longer)
    assert np.abs(np.array(graph.poses) - before).max() < 1e-9
    assert not graph.places
    assert not landmarks.transmitters(graph)
    # As strong as from its place, the same arrivals do hold the poses.
    right, same, _ = _receive_falsely(np.array([8.0, 6.0]), 1.0)
    assert len(right.places) == 1
    assert np.abs(np.array(right.poses) - same).max() > 0.01


def test_what_directions_do_not_place_moves_no_pose() -> None:
    """From 2 km ahead every direction is the same and every strength fits: no position is found, so poses stay."""
    graph, before, _ = _receive_falsely(np.array([2000.0, 0.0]), 1.0)
    assert np.abs(np.array(graph.poses) - before).max() < 1e-9
    assert not graph.places


def test_a_source_is_found_after_a_false_line_of_sight() -> None:
    """Ten arrivals off a corner, then the source itself: it stands where it does, by what was seen of it alone."""
    rng = np.random.default_rng(12)
    corner, place = np.array([5.0, 3.0]), np.array([14.0, 6.0])
    graph, true = _walk(rng, 25, noise=0.1)
    estimate, landmarks = PoseGraph(np.zeros(3)), Landmarks()
    for k, pose in _along(graph, true, estimate):
        received = _bearing(pose, corner if k < 10 else place, rng, direct=0.95, spread=0.01)
        if k < 10:
            received = Bearing(**{**vars(received), "range_m": 4 * received.range_m})
        landmarks.see(estimate, np.zeros(3), SURE, [received])
    estimate.solve()
    found = landmarks.transmitters(estimate)["a"]
    assert np.hypot(*(found.xy - place)) < 0.2
    assert found.sightings == 16


def test_a_bearing_is_as_uncertain_as_the_pose_it_was_taken_from() -> None:
    """With the heading open by 1 degree in addition to 0.4 of the radio, sightings weigh as of sqrt(1.16) degrees."""
    rng, landmarks = np.random.default_rng(13), Landmarks()
    graph, true = _walk(rng, 25, noise=0.1)
    spread = np.diag([0.0, 0.0, math.radians(1.0)]) ** 2
    estimate = PoseGraph(np.zeros(3))
    for _, pose in _along(graph, true, estimate):
        landmarks.see(estimate, np.zeros(3), spread, [_bearing(pose, np.array([8.0, 6.0]), rng)])
    assert {round(math.degrees(one.sigma_rad), 6) for one in estimate.sightings} == {
        round(math.sqrt(1.16), 6)
    }


def test_mirror_images_are_followed_next_to_the_source() -> None:
    """Two further paths, known by how much farther they came: two landmarks in their places, and one transmitter."""
    rng = np.random.default_rng(7)
    places = np.array([[8.0, 6.0], [8.0, 14.0], [28.0, 6.0]])
    graph, true = _walk(rng, 25)
    estimate, landmarks = PoseGraph(np.zeros(3)), Landmarks()
    for _, pose in _along(graph, true, estimate):
        gaps = np.hypot(*(places - pose[:2]).T)
        received = [_bearing(pose, places[0], rng)]
        for place, gap in zip(places[1:], gaps[1:], strict=True):
            beyond_m = float(gap - gaps[0] + rng.normal(0, 0.05))
            received.append(_bearing(pose, place, rng, direct=0.0, beyond_m=beyond_m))
        landmarks.see(estimate, np.zeros(3), SURE, received)
        estimate.solve()
    assert set(landmarks.transmitters(estimate)) == {"a"}
    assert len(estimate.places) == 3
    for place in places:
        assert min(np.hypot(*(np.array(estimate.places) - place).T)) < 0.5


def test_bearings_from_one_place_count_once() -> None:
    """From one place bearings err alike: they are taken again after 15 cm or 15 degrees."""
    landmarks, graph, rng = Landmarks(), PoseGraph(np.zeros(3)), np.random.default_rng(6)
    for _ in range(20):
        landmarks.see(graph, np.zeros(3), SURE, [_bearing(np.zeros(3), np.array([3.0, 4.0]), rng)])
    assert not graph.places
