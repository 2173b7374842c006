"""Places from paths: exact in a room of mirror images, calibrated under noise, and on paths measured in a real hall."""

import math

import numpy as np
import pytest

from robosim.calibration.measured_paths import read_measured_paths
from tests.benchmarks.positioning import locate_together, seen_from_receiver, seen_from_transmitter
from wireless.positioning.single_bounce import (
    MeasuredPaths,
    PositioningConfig,
    locate,
)

#: Walls of a room of 9 m by 6 m: axis, and where on it.
WALLS = [(0, 0.0), (0, 9.0), (1, 0.0), (1, 6.0)]
KNOWN = np.array([2.0, 1.5])
FINE = PositioningConfig(sigma_length_m=1e-3, sigma_known_rad=1e-4, sigma_own_rad=1e-4)


def in_room(pose, offset_m=0.0, straight=True, noise=None, wild=0, rng=None) -> MeasuredPaths:
    """Line of sight and the four first reflections by mirror images, and paths from nowhere next to them."""
    rng, rows = rng or np.random.default_rng(0), []
    images = [KNOWN] if straight else []
    for axis, at in WALLS:
        image = KNOWN.copy()
        image[axis] = 2 * at - image[axis]
        images.append(image)
    for image in images:
        seen = image - pose[:2]
        arrive = math.atan2(seen[1], seen[0])
        leave = -seen
        for axis, at in WALLS:
            if image[axis] == 2 * at - KNOWN[axis] and image[1 - axis] == KNOWN[1 - axis]:
                leave[axis] *= -1
        rows.append((math.atan2(leave[1], leave[0]), arrive - pose[2], math.hypot(*seen) + offset_m))
    rows += [tuple(row) for row in rng.uniform([-math.pi, -math.pi, 4], [math.pi, math.pi, 20], (wild, 3))]
    known, own, length = np.array(rows).T
    if noise is not None:
        known = known + rng.normal(0, noise.sigma_known_rad, len(known))
        own = own + rng.normal(0, noise.sigma_own_rad, len(own))
        length = length + rng.normal(0, noise.sigma_length_m, len(length))
    return MeasuredPaths(
        known_xy=np.tile(KNOWN, (len(known), 1)), known_rad=known, own_rad=own, length_m=length
    )


def turn(angle: float) -> float:
    return (angle + math.pi) % (2 * math.pi) - math.pi


@pytest.mark.parametrize("straight", [True, False], ids=["line of sight", "bounces alone"])
@pytest.mark.parametrize("offset_m", [0.0, 1.7])
def test_without_noise_it_is_exact(straight, offset_m):
    """Place, heading and clock to a millionth, though a third of the paths come from nowhere."""
    pose = np.array([6.3, 4.1, 2.2])
    found = locate(in_room(pose, offset_m, straight, wild=2), FINE)
    np.testing.assert_allclose(found.pose, pose, atol=1e-6)
    assert found.offset_m == pytest.approx(offset_m, abs=1e-6)
    np.testing.assert_array_equal(found.explained, [True] * (4 + straight) + [False] * 2)
    assert found.straight.sum() == straight


def test_with_the_clock_known_three_bounces_do():
    pose = np.array([7.0, 2.0, -0.4])
    paths = in_room(pose, straight=False)
    np.testing.assert_allclose(locate(paths.chosen(slice(3)), FINE, offset_m=0.0).pose, pose, atol=1e-6)


def test_the_covariance_is_that_of_the_errors():
    """Squared errors over their variance, of 30 draws in line of sight, are 1 on the average within a half."""
    config, rng = PositioningConfig(heading_step_rad=0.2), np.random.default_rng(3)
    pose, squares = np.array([6.5, 3.5, 1.0]), []
    for _ in range(30):
        found = locate(in_room(pose, 0.5, noise=config, rng=rng), config)
        error = np.append(found.pose - pose, found.offset_m - 0.5)
        error[2] = turn(error[2])
        squares.append(error @ np.linalg.solve(found.covariance, error) / 4)
    assert 0.67 < np.mean(squares) < 1.5


def test_places_share_a_clock():
    """Three places with noise: one offset, and places nearer than each place's clock alone would give."""
    config, rng = PositioningConfig(heading_step_rad=0.2), np.random.default_rng(5)
    poses = np.array([[6.5, 3.5, 1.0], [4.0, 4.8, -2.0], [7.5, 1.2, 0.1]])
    places = [in_room(pose, 1.1, noise=config, rng=rng) for pose in poses]
    together, alone = locate_together(places, config), [locate(paths, config) for paths in places]
    assert len({found.offset_m for found in together}) == 1
    assert abs(together[0].offset_m - 1.1) < max(abs(found.offset_m - 1.1) for found in alone)
    off = [
        [np.hypot(*(f.pose - pose)[:2]) for f, pose in zip(found, poses, strict=True)]
        for found in (together, alone)
    ]
    assert np.linalg.norm(off[0]) < min(np.linalg.norm(off[1]), 0.6)


def test_too_few_paths_are_rejected():
    paths = in_room(np.array([6.0, 3.0, 0.0]))
    with pytest.raises(ValueError, match="2 paths, expected 3 at least"):
        locate(paths.chosen(slice(2)))


@pytest.fixture(scope="module")
def hall(shared):
    return read_measured_paths(shared / "data" / "kampusareena-60ghz" / "paths.csv", math.radians(-1.6))


def test_a_receiver_in_a_real_hall(hall):
    """Every fifth of 45 places: half within 0.5 m and 2 degrees with the clock unknown, within 0.2 m with it known."""
    seen, truth = seen_from_transmitter(hall)[::5], hall.receivers[::5]
    free = np.array([locate(paths).pose for paths in seen])
    assert np.median(np.hypot(*(free - truth)[:, :2].T)) < 0.5
    assert np.median(np.abs(turn(free[:, 2] - truth[:, 2]))) < math.radians(2)
    timed = np.array([locate(paths, offset_m=0.0).pose for paths in seen])
    off = np.sort(np.hypot(*(timed - truth)[:, :2].T))
    assert np.median(off) < 0.2
    assert off[-2] < 0.7


def test_the_transmitter_in_a_real_hall(hall):
    """From the receiver's places, by the 362 paths at once: within 0.2 m and 1.5 degrees, clock unknown."""
    found = locate(seen_from_receiver(hall))
    assert np.hypot(*(found.pose - hall.transmitter)[:2]) < 0.2
    assert abs(turn(found.pose[2] - hall.transmitter[2])) < math.radians(1.5)
    assert abs(found.offset_m) < 0.3
