"""Specular paths next to Sionna RT's: links per second of the processor, and which paths each finds.

Both trace the same building, as `robosim plan` writes it for Sionna RT, and the scenes that Sionna RT ships:
reflections by exact images here, by shooting samples and refining them there. A path is found by both if their lengths
differ by less than `SAME_M`.

Reference: Sionna RT (Aoudia et al., arXiv:2504.21719).
"""

import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.constants import speed_of_light
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import Building, BuildingConfig, make_building
from robosim.building.mesh_export import export_mitsuba
from robosim.plans.floorplan import FloorPlan
from tests.benchmarks.harness import DEFAULT, Options, alternate, console, free_places, plans_of
from tests.benchmarks.results import Results
from wireless.geometry.array_types import Point, Points
from wireless.tracing.mitsuba_scene import read_mitsuba
from wireless.tracing.tracer import Tracer, TracerConfig

#: Sionna RT computes with 32 bits: lengths that differ by less are those of one path [m].
SAME_M = 2e-3
#: Heights of the building, of transmitter and receivers, which differ so that mirrored paths do not coincide [m].
HEIGHT_M, TX_M, RX_M = 3.0, 2.1, 1.3
#: Half-spaces, which both know; what stands for layered walls in Sionna RT reflects otherwise near their resonances.
MATERIALS: dict[str, Any] = {
    f"{kind}_material": "concrete" for kind in ("wall", "floor", "ceiling", "furniture")
}
FREQUENCY_HZ = 28e9
#: More paths than any link has.
ALL = 5000
SAMPLES = (10_000, 100_000)
#: In shipped scenes: carrier of Sionna RT's examples, whose materials are known there, and samples.
SCENE_HZ, SCENE_SAMPLES = 3.5e9, 1_000_000
#: Places are in a box of at least and at most these sides, in the middle of a scene [m].
LEAST_M, MOST_M = 10.0, 200.0
#: Of so many places the transmitter is at the one with the most paths: others may be within a building.
TRIED = 10
FIND_SCENES = (
    "from importlib.util import find_spec; print(find_spec('sionna.rt.scenes').submodule_search_locations[0])"
)
WORKER = Path(__file__).with_name("tracer_peer_worker.py")


def main(
    plans: Positional[tuple[str, ...]] = ("flat", "office"),
    *,
    python: str = "python",
    receivers: int = 400,
    order: int = 3,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Specular paths next to Sionna RT's: links per second of the processor, and recall.

    Args:
        plans: Floor plans, or folders of them.
        python: A Python that has Sionna RT; without it, nothing is measured.
        receivers: Receivers of each plan and scene.
        order: Most reflections.
        options: Of every benchmark.
    """
    results = Results()
    scenes = find_scenes(python, "tracer_peer")
    if scenes is None:
        return results
    for plan in plans_of(plans):
        measure(plan, python, receivers, order, options.seed, results)
    for scene in sorted(scenes.glob("*/*.xml")):
        measure_scene(scene, python, receivers, options.seed, results)
    return options.finish("tracer_peer", results)


def find_scenes(python: str, benchmark: str) -> Path | None:
    """Folder of the scenes of Sionna RT; None, with a line that the benchmark is skipped, if a Python has none."""
    try:
        run = subprocess.run([python, "-c", FIND_SCENES], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        console.print(f"{benchmark} is skipped: {python} has no Sionna RT. Give --python one that has.")
        return None
    return Path(run.stdout.strip())


def specular(order: int, paths: int) -> TracerConfig:
    """Lines of sight and reflections on all surfaces, at most so many paths of a link."""
    return TracerConfig(
        max_reflections=order, max_paths=paths, floor_ceiling=True, diffraction=False, max_transmissions=0
    )


def measure(plan: FloorPlan, python: str, receivers: int, order: int, seed: int, results: Results) -> None:
    """Rates, numbers of paths, and the strongest path of each link, by both programs."""
    building = make_building(plan, config=BuildingConfig(height_m=HEIGHT_M, **MATERIALS))
    place = free_places(building.free, 1 + receivers, np.random.default_rng(seed))
    tx = np.array([[*place[0], TX_M]])
    rx = np.column_stack([place[1:], np.full(receivers, RX_M)])
    tracers = {
        count: Tracer(building, frequency_hz=FREQUENCY_HZ, config=specular(order, count))
        for count in (25, ALL)
    }
    trace = {
        count: lambda tracer=tracer: tracer.trace(tx, rx, workers=1) for count, tracer in tracers.items()
    }
    seconds = alternate(trace, turns=5)
    for count in tracers:
        row = f"{plan.name}, at most {count} paths"
        rate = receivers / np.median(seconds[count])
        results.add("peer", row, "links a CPU second", rate, digits=0, cases=receivers)
        results.add("peer", row, "paths", len(trace[count]()), digits=0)
    paths = trace[ALL]()
    power = np.abs(paths.gain[:, 0, 0]) ** 2  # both polarisations are vertical, as in Sionna RT
    own = [_by_length(paths.delay_s[paths.rx == k], power[paths.rx == k]) for k in range(receivers)]
    found = _peer(building, python, tx, rx, order)
    for samples in SAMPLES:
        row = f"{plan.name}, Sionna RT {found['version']} with {samples} samples"
        peer = [
            _by_length(delay[power > 0], power[power > 0])
            for delay, power in zip(found[f"delay_s_{samples}"], found[f"power_{samples}"], strict=True)
        ]
        both = sum(len(_matches(*pair)) for pair in zip(own, peer, strict=True))
        n_peer = sum(map(len, peer))
        difference = [
            abs(10 * np.log10(theirs[:, 1].max() / ours[:, 1].max()))
            for ours, theirs in zip(own, peer, strict=True)
            if len(ours) and len(theirs)
        ]
        rate = receivers / float(found[f"cpu_s_{samples}"])
        results.add("peer", row, "links a CPU second", rate, digits=0, cases=receivers)
        results.add("peer", row, "paths", n_peer, digits=0)
        results.add("peer", row, "found by both", both, digits=0)
        worst = np.quantile(difference, 0.95)
        results.add("peer", row, "strongest path, 95 % within", worst, "dB", digits=4, cases=len(difference))


def measure_scene(scene: Path, python: str, receivers: int, seed: int, results: Results) -> None:
    """Lines of sight and first reflections of a shipped scene, by both programs."""
    config = specular(1, ALL)
    mesh = read_mitsuba(scene).mesh
    places = scene_places(mesh.bounds, TRIED + receivers, np.random.default_rng(seed))
    rx = places[TRIED:]
    paths = Tracer.from_mitsuba(scene, frequency_hz=SCENE_HZ, config=config).trace(places[:TRIED], rx)
    best = int(np.argmax(paths.count().sum(axis=1)))
    paths, tx = paths.select(paths.tx == best), places[best : best + 1]
    power = np.abs(paths.gain[:, 0, 0]) ** 2
    found = _run_worker(python, scene, tx, rx, 1, (SCENE_SAMPLES,), SCENE_HZ)
    delay, theirs, turns = (found[f"{name}_{SCENE_SAMPLES}"] for name in ("delay_s", "power", "turns"))
    difference: list[float] = []
    for name, order in (("line of sight", 0), ("reflections", 1)):
        both = n_own = alone = twice = confirmed = 0
        for k in range(receivers):
            mine = np.flatnonzero((paths.rx == k) & (paths.order == order))
            mine, other = mine[np.argsort(paths.delay_s[mine])], (theirs[k] > 0) & (turns[k] == order)
            own, peer = (
                _by_length(paths.delay_s[mine], power[mine]),
                _by_length(delay[k, other], theirs[k, other]),
            )
            pairs = _matches(own, peer)
            both, n_own = both + len(pairs), n_own + len(own)
            rest = np.delete(peer[:, 0], [j for _, j in pairs])
            again = np.isclose(rest[:, None], own[:, 0], rtol=0, atol=SAME_M).any(axis=1)
            alone, twice = alone + int((~again).sum()), twice + int(again.sum())
            difference += [abs(10 * np.log10(own[i, 1] / peer[j, 1])) for i, j in pairs]
            for path in np.delete(mine, [i for i, _ in pairs]) if order else ():
                confirmed += is_reflection(mesh.triangles, tx[0], paths.point[path, 0], rx[k])
        results.add("scenes", scene.stem, f"{name}: both", both, digits=0, cases=receivers)
        results.add("scenes", scene.stem, f"{name}: here alone", n_own - both, digits=0)
        if order:
            results.add("scenes", scene.stem, "confirmed", confirmed, digits=0)
        results.add("scenes", scene.stem, f"{name}: there alone", alone, digits=0)
        if order:
            results.add("scenes", scene.stem, "there twice", twice, digits=0)
    if difference:
        worst = np.quantile(difference, 0.95)
        results.add(
            "scenes", scene.stem, "strength, 95 % within", worst, "dB", digits=4, cases=len(difference)
        )


def is_reflection(triangles: Float[np.ndarray, "n 3 3"], tx: Point, point: Point, rx: Point) -> bool:
    """Whether a triangle reflects at a point, by the law of reflection, and none is between it and both ends."""
    ends = np.array([tx, rx])
    distance = np.linalg.norm(ends - point, axis=1)
    up = ((ends - point) / distance[:, None]).sum(axis=0)
    up *= SAME_M / np.linalg.norm(up)
    mirrors, _ = _crossed(triangles, point + up, point - up)
    normals = np.cross(*(triangles[mirrors, corner] - triangles[mirrors, 0] for corner in (1, 2)))
    cosine = np.abs(normals @ up) / (np.linalg.norm(normals, axis=1) * SAME_M)
    free = [
        not (_crossed(triangles, end, point)[1] * length < length - SAME_M).any()
        for end, length in zip(ends, distance, strict=True)
    ]
    return bool((cosine > 1 - 1e-6).any() and all(free))


def _crossed(
    triangles: Float[np.ndarray, "n 3 3"], start: Point, end: Point
) -> tuple[Int[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Triangles that a straight line crosses, and at which share of it (Möller and Trumbore, 1997)."""
    along, corner = end - start, triangles[:, 0]
    first, second = triangles[:, 1] - corner, triangles[:, 2] - corner
    across = np.cross(along, second)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1 / np.einsum("ni,ni->n", first, across)
        u = np.einsum("ni,ni->n", start - corner, across) * scale
        turned = np.cross(start - corner, first)
        v, share = turned @ along * scale, np.einsum("ni,ni->n", second, turned) * scale
        hit = np.flatnonzero((u >= 0) & (v >= 0) & (u + v <= 1) & (share > 0) & (share < 1))
    return hit, share[hit]


def scene_places(bounds: Float[np.ndarray, "2 3"], count: int, rng: np.random.Generator) -> Points:
    """Random places in the middle of a scene, above its lowest point."""
    side = np.clip(np.ptp(bounds, axis=0), LEAST_M, MOST_M)
    low = bounds.mean(axis=0) - side / 2
    low[2] = bounds[0, 2]
    return rng.uniform(low, low + side, (count, 3))


def _peer(building: Building, python: str, tx: Points, rx: Points, order: int) -> dict[str, Any]:
    """What the worker found in a building, for each number of samples."""
    with tempfile.TemporaryDirectory() as folder:
        scene = export_mitsuba(building, Path(folder), frequency_hz=FREQUENCY_HZ)
        return _run_worker(python, scene, tx, rx, order, SAMPLES, FREQUENCY_HZ)


def _run_worker(
    python: str,
    scene: Path,
    tx: Points,
    rx: Points,
    order: int,
    samples: tuple[int, ...],
    frequency_hz: float,
) -> dict[str, Any]:
    """What the worker found in a scene, for each number of samples."""
    with tempfile.TemporaryDirectory() as folder:
        places, found = Path(folder) / "places.npz", Path(folder) / "found.npz"
        np.savez(places, tx=tx[0], rx=rx, frequency_hz=frequency_hz, depth=order, samples=samples)
        subprocess.run([python, WORKER, scene, places, found], check=True)
        return dict(np.load(found))


def _by_length(delay_s: Float[np.ndarray, " n"], power: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 2"]:
    """Lengths [m] and powers of a link's paths, the shortest first."""
    order = np.argsort(delay_s)
    return np.column_stack([speed_of_light * delay_s[order], power[order]])


def _matches(own: Float[np.ndarray, "n 2"], peer: Float[np.ndarray, "m 2"]) -> list[tuple[int, int]]:
    """Which paths of two lists, sorted by length, are pairs of one length."""
    pairs, i, j = [], 0, 0
    while i < len(own) and j < len(peer):
        difference = own[i, 0] - peer[j, 0]
        if abs(difference) <= SAME_M:
            pairs.append((i, j))
            i, j = i + 1, j + 1
        elif difference < 0:
            i += 1
        else:
            j += 1
    return pairs
