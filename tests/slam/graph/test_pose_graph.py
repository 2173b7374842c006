"""The pose graph against closed forms, against another solver, and against wrong loops."""

import math

import numpy as np
import pytest
from scipy.optimize import least_squares

from slam.graph.least_squares import Constraint, Sighting
from slam.graph.pose_graph import PoseGraph, chained
from slam.poses import between, compose

STEP = np.diag([0.03, 0.03, 0.01]) ** 2
LOOP = np.diag([0.02, 0.02, 0.005]) ** 2


def test_what_a_loop_shows_is_spread_over_the_steps_by_their_variances():
    """On a line, step k moves by its share of the sum of variances: exactly, to 1e-9 m."""
    deviation = np.array([0.01, 0.02, 0.03, 0.04])
    graph = PoseGraph(np.zeros(3))
    for k, sigma in enumerate(deviation):
        graph.add(np.array([k + 1.0, 0.0, 0.0]))
        covariance = np.diag([sigma, 0.01, 0.01]) ** 2
        graph.hold(Constraint(first=k, second=k + 1, pose=np.array([1.0, 0, 0]), covariance=covariance))
    exact = 1e-14 * np.eye(3)
    graph.hold(Constraint(first=0, second=4, pose=np.array([4.1, 0, 0]), covariance=exact))
    graph.solve()
    expected = np.cumsum(1 + 0.1 * deviation**2 / (deviation**2).sum())
    np.testing.assert_allclose(np.array(graph.poses)[1:, 0], expected, atol=1e-9)


def _ring(rng: np.random.Generator, count: int = 120) -> tuple[PoseGraph, np.ndarray]:
    """A square route with noisy steps, and the true poses."""
    true = [np.zeros(3)]
    for k in range(count - 1):
        turn = math.pi / 2 if k % (count // 4) == count // 4 - 1 else 0.0
        true.append(compose(true[-1], np.array([1.0, 0.0, turn])))
    graph = PoseGraph(true[0])
    for k in range(1, count):
        step = between(true[k - 1], true[k]) + rng.multivariate_normal(np.zeros(3), STEP)
        graph.add(compose(graph.poses[-1], step))
        graph.hold(Constraint(first=k - 1, second=k, pose=step, covariance=STEP))
    return graph, np.array(true)


def _close(graph: PoseGraph, true: np.ndarray, rng: np.random.Generator, count: int, wrong: int) -> None:
    last = len(true)
    for k in range(count + wrong):
        first, second = int(rng.integers(0, last // 4)), int(rng.integers(3 * last // 4, last))
        pose = between(true[first], true[second]) + rng.multivariate_normal(np.zeros(3), LOOP)
        if k >= count:
            pose = pose + rng.uniform(0.5, 3.0, 3) * rng.choice([-1, 1], 3)
        graph.hold(Constraint(first=first, second=second, pose=pose, covariance=LOOP, loop=True))


def test_it_finds_what_another_solver_finds():
    """SciPy's trust region on the same squares, from the same start: poses within 1e-5."""
    rng = np.random.default_rng(0)
    graph, true = _ring(rng, 40)
    _close(graph, true, rng, 6, 0)
    for number, one in enumerate(graph.constraints):
        graph.constraints[number] = Constraint(
            first=one.first, second=one.second, pose=one.pose, covariance=one.covariance
        )
    roots = [np.linalg.cholesky(np.linalg.inv(one.covariance)).T for one in graph.constraints]

    def errors(values: np.ndarray) -> np.ndarray:
        poses = np.vstack([np.zeros(3), values.reshape(-1, 3)])
        found = []
        for root, one in zip(roots, graph.constraints, strict=True):
            off = between(poses[one.first], poses[one.second]) - one.pose
            off[2] = (off[2] + math.pi) % (2 * math.pi) - math.pi
            found.append(root @ off)
        return np.concatenate(found)

    judge = least_squares(errors, np.array(graph.poses[1:]).ravel(), xtol=1e-12, ftol=1e-12)
    graph.solve()
    off = np.array(graph.poses[1:]) - judge.x.reshape(-1, 3)
    off[:, 2] = (off[:, 2] + math.pi) % (2 * math.pi) - math.pi
    assert np.abs(off).max() < 1e-5


@pytest.mark.parametrize("seed", range(5))
def test_wrong_loops_lose_their_weight(seed):
    """20 right loops, 15 wrong by 0.9 m at least: those end below 0.05, poses are what right ones give, to 2 cm."""
    graph, true = _ring(np.random.default_rng(seed))
    judge, _ = _ring(np.random.default_rng(seed))
    _close(graph, true, np.random.default_rng(10 + seed), 20, 15)
    _close(judge, true, np.random.default_rng(10 + seed), 20, 0)
    graph.solve()
    judge.solve()
    loops = [w for one, w in zip(graph.constraints, graph.weights, strict=True) if one.loop]
    assert max(loops[20:]) < 0.05
    assert np.mean(loops[:20]) > 0.7
    assert np.hypot(*(np.array(graph.poses) - np.array(judge.poses))[:, :2].T).max() < 0.02


def test_uncertainty_along_a_chain_is_that_of_many_chains():
    """Of 4,000 noisy chains with turns, the ends spread as estimated, within 8 %."""
    rng = np.random.default_rng(1)
    steps = [np.array([1.0, 0.1, 0.3])] * 6
    graph = PoseGraph(np.array([2.0, -1.0, 0.7]))
    for k, step in enumerate(steps):
        graph.add(compose(graph.poses[-1], step))
        graph.hold(Constraint(first=k, second=k + 1, pose=step, covariance=STEP))
    found = graph.uncertainty(0)[6]
    ends = []
    for _ in range(4000):
        pose = np.zeros(3)
        for step in steps:
            pose = compose(pose, step + rng.multivariate_normal(np.zeros(3), STEP))
        ends.append(pose)
    spread = np.cov(np.array(ends).T)
    np.testing.assert_allclose(np.sqrt(np.diag(found)), np.sqrt(np.diag(spread)), rtol=0.08)
    # From the other end it is the same chain: the inverse of the last pose, seen from there.
    back = graph.uncertainty(6)[0]
    assert np.linalg.det(back) == pytest.approx(np.linalg.det(found), rel=1e-6)


@pytest.mark.parametrize(("start", "node"), [(0, 5), (5, 0), (2, 4), (4, 1)])
def test_uncertainty_is_that_of_random_chains(start, node):
    """Against 100,000 chains whose displacements err: within 3 % of the covariance, forwards and backwards."""
    rng, graph = np.random.default_rng(7), PoseGraph(np.array([1.0, -2.0, 0.4]))
    tracks = np.tile(graph.poses[0], (100_000, 1))[None].repeat(6, axis=0)
    for k in range(5):
        step = np.array([2.0 + k, rng.normal(), rng.uniform(-1, 1)])
        root = rng.normal(size=(3, 3)) * [[2e-3], [2e-3], [1e-3]]
        graph.hold(
            Constraint(
                first=k, second=graph.add(compose(graph.poses[k], step)), pose=step, covariance=root @ root.T
            )
        )
        tracks[k + 1] = chain(tracks[k], step + rng.normal(size=(100_000, 3)) @ root.T)
    away = tracks[node] - tracks[start]
    c, s = np.cos(tracks[start, :, 2]), np.sin(tracks[start, :, 2])
    seen = np.column_stack([c * away[:, 0] + s * away[:, 1], c * away[:, 1] - s * away[:, 0], away[:, 2]])
    found, expected = graph.uncertainty(start)[node], np.cov(seen.T)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.03)


def chain(poses, steps):
    """Poses after steps in their own frames, without wrapping angles."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y, turn = steps.T
    return poses + np.column_stack([c * x - s * y, s * x + c * y, turn])


def test_a_loop_shortens_the_chain():
    """With the ends tied, the last pose is as sure as the tie."""
    rng = np.random.default_rng(2)
    graph, true = _ring(rng, 40)
    before = graph.uncertainty(0)[39]
    graph.hold(Constraint(first=0, second=39, pose=between(true[0], true[39]), covariance=LOOP, loop=True))
    graph.solve()
    np.testing.assert_allclose(graph.uncertainty(0)[39], LOOP, rtol=1e-6, atol=1e-12)
    assert np.trace(before) > 20 * np.trace(LOOP)


def test_chaining_with_an_exact_pose_only_turns():
    covariance = np.diag([1.0, 4.0, 9.0])
    turned = chained(np.array([5.0, 5.0, math.pi / 2]), np.zeros((3, 3)), np.zeros(3), covariance)
    np.testing.assert_allclose(turned, np.diag([4.0, 1.0, 9.0]), atol=1e-12)


def test_merging_a_pose_leaves_the_chain_of_covariances():
    """On a line 0-1-2-3, pose 2 merged with 1: the others stay, and 0 to 3 is the sum of steps, closed form.

    The displacement 1 to 2 counts once as part of the chain from 1 to the next.
    """
    graph, step = PoseGraph(np.zeros(3)), np.array([1.0, 0.0, 0.3])
    for k in range(3):
        graph.add(compose(graph.poses[-1], step))
        graph.hold(Constraint(first=k, second=k + 1, pose=step, covariance=STEP))
    before, spread = np.array(graph.poses), graph.uncertainty(0)[3]
    at = graph.merge(2, 1)
    np.testing.assert_allclose(at, step, atol=1e-12)
    np.testing.assert_allclose(np.array(graph.poses), before[[0, 1, 3]], atol=1e-12)
    np.testing.assert_allclose(graph.uncertainty(0)[2], spread, rtol=1e-9, atol=1e-12)
    assert {(c.first, c.second) for c in graph.constraints} == {(0, 1), (1, 2)}
    graph.solve()
    np.testing.assert_allclose(np.array(graph.poses), before[[0, 1, 3]], atol=1e-9)


def test_merged_poses_keep_one_displacement_of_a_pair():
    """Of two routes between two places, the more certain stays, and no second loop of a pair."""
    graph = PoseGraph(np.zeros(3))
    for k in range(1, 5):
        graph.add(np.array([float(k % 2), 0.0, 0.0]))
        pose = np.array([1.0 if k % 2 else -1.0, 0.0, 0.0])
        graph.hold(Constraint(first=k - 1, second=k, pose=pose, covariance=STEP / k))
    graph.hold(Constraint(first=2, second=0, pose=np.zeros(3), covariance=1e-9 * np.eye(3), loop=True))
    graph.hold(Constraint(first=3, second=1, pose=np.zeros(3), covariance=1e-9 * np.eye(3), loop=True))
    graph.merge(2, 0)
    graph.merge(2, 1)
    pairs = [{c.first, c.second} for c in graph.constraints]
    assert sorted(map(sorted, pairs)) == [[0, 1], [1, 2]]
    np.testing.assert_allclose(graph.constraints[0].covariance, STEP / 3, rtol=0.1, atol=1e-7)


def test_a_sighting_from_a_merged_pose_keeps_its_place_on_the_map():
    """Seen from pose 1, which is merged with 0: seen from the same point of `map`; later numbers decrease."""
    graph, step = PoseGraph(np.array([1.0, 2.0, 0.5])), np.array([1.0, 0.2, 0.3])
    for k in range(2):
        graph.add(compose(graph.poses[-1], step))
        graph.hold(Constraint(first=k, second=k + 1, pose=step, covariance=STEP))
    graph.add_place(np.array([5.0, 5.0]))
    at = np.array([0.3, 0.1, -0.2])
    for pose in (1, 2):
        graph.see(
            Sighting(pose=pose, at=at, place=0, bearing_rad=0.1, sigma_rad=0.1, range_m=5, sigma_range=1)
        )
    before = [compose(graph.poses[one.pose], one.at) for one in graph.sightings]
    graph.merge(1, 0)
    assert [one.pose for one in graph.sightings] == [0, 1]
    after = [compose(graph.poses[one.pose], one.at) for one in graph.sightings]
    np.testing.assert_allclose(after, before, atol=1e-12)
