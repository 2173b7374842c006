"""Digests of what the system computes, to show that a change of the code changes no result.

    python scripts/digests.py > before.json        # in a checkout of the former commit
    python scripts/digests.py > after.json
    diff before.json after.json

Episodes, data sets and trainings are run by the command line, traces by the public interface. Digests cover arrays and
scores; not versions, times of day and durations. They are those of one machine and its libraries. `--only WORD` selects
by name.
"""

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

_STOREYS = """
storeys:
  - plan: flat
    openings: [[[6.0, 5.0], [7.0, 5.0], [7.0, 7.4], [6.0, 7.4]]]
  - plan: flat
"""
_SHORT = "--max-steps 60 --no-video"
#: Arguments of `robosim episode`; paths in braces are written first.
EPISODES = {
    "demo": "office --goal fused --seed 2 --no-video",
    "learned": f"office --seed 2 {_SHORT}",
    "oracle": f"flat --goal oracle --physics kinematic {_SHORT}",
    "shortest": f"flat --goal shortest --physics kinematic {_SHORT}",
    "explore": f"flat --goal explore --mapper classical --explorer gain {_SHORT}",
    "visual": f"flat --goal visual {_SHORT}",
    "snr": f"flat --goal snr {_SHORT}",
    "los": f"office --goal los --physics kinematic {_SHORT}",
    "los-or-first": f"office --goal los-or-first --physics kinematic {_SHORT}",
    "rss": f"flat --goal rss --band ble {_SHORT}",
    "fused-ble": f"flat --goal fused --band ble --physics kinematic {_SHORT}",
    "turtlebot4": f"flat --goal fused --robot turtlebot4 {_SHORT}",
    "jackal": f"office --goal fused --robot jackal --mapper classical {_SHORT}",
    "lidar": f"flat --goal fused --camera none --lidar rplidar-a1 --mapper classical {_SHORT}",
    "people": f"office --goal fused --people 5 {_SHORT}",
    "velocity": f"flat --goal fused --controller velocity {_SHORT}",
    "anchors": f"flat --goal fused --anchor a,3.1,3.4 --seed 1 {_SHORT}",
}
COMMANDS = {
    "dataset": "dataset flat --tx-per-plan 2 --grid 0.6",
    "dataset-storeys": "dataset {storeys} --tx-per-plan 2 --grid 1.0",
    "train-search": "train search --smoke",
    "train-explorer": "train explorer --smoke",
    "collect": "collect --homes 1 --steps 20",
}


def digest(array: np.ndarray) -> str:
    """Digest of an array's values."""
    values = np.ascontiguousarray(array)
    content = values.tobytes() if values.dtype != object else repr(values.tolist()).encode()
    return hashlib.sha256(f"{values.dtype.str} {values.shape}".encode() + content).hexdigest()[:12]


def folder_digests(folder: Path) -> dict[str, str]:
    """Digests of the files of an output folder."""
    digests = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.suffix == ".npz":
            with np.load(path) as arrays:
                digests |= {
                    f"{name}:{key}": digest(arrays[key]) for key in arrays if key not in ("meta", "head")
                }
        elif path.suffix == ".parquet":
            import pyarrow.parquet

            table = pyarrow.parquet.read_table(path)
            digests[name] = hashlib.sha256(repr(table.to_pydict()).encode()).hexdigest()[:12]
        elif path.suffix in (".tum", ".pgm", ".csv"):
            digests[name] = hashlib.sha256(path.read_bytes()).hexdigest()[:12]
        elif path.suffix == ".safetensors":
            from safetensors.numpy import load_file

            weights = load_file(path)
            digests[name] = hashlib.sha256(
                b"".join(weights[key].tobytes() for key in sorted(weights))
            ).hexdigest()[:12]
        elif path.name == "result.json":
            result = json.loads(path.read_text())
            scores = {key: value for key, value in result.items() if isinstance(value, int | float | str)}
            for key in [
                key
                for key in scores
                if key.endswith(("per_s", "seconds")) or key in ("version", "commit", "date")
            ]:
                del scores[key]
            digests[name] = json.dumps(scores, sort_keys=True)
    return digests


def run_command(words: str) -> dict[str, str]:
    """Digests of the files that a command writes."""
    with tempfile.TemporaryDirectory() as folder:
        (storeys := Path(folder, "house.yaml")).write_text(_STOREYS)
        out = Path(folder, "out")
        command = [
            sys.executable,
            "-m",
            "robosim",
            *words.format(storeys=storeys).split(),
            "--quiet",
            "--out",
            str(out),
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            return {"error": done.stderr}
        return folder_digests(out)


def trace_plan() -> dict[str, str]:
    """Traces in the outline of a floor plan, at 28 and 2.4 GHz."""
    import robosim
    import wireless

    building = robosim.make_building(robosim.read_plan("office"))
    return {
        str(frequency): paths_digest(
            wireless.Tracer(building, frequency_hz=frequency).trace(*points(building.plan))
        )
        for frequency in (28e9, 2.4e9)
    }


def trace_storeys() -> dict[str, str]:
    """Traces through two storeys with an opening, from the lower one to both."""
    import robosim
    import wireless
    from robosim.building.multi_storey import make_storeys
    from robosim.plans.storey_plans import StoreyPlan, StoreysPlan

    flat = robosim.read_plan("flat")
    stairs = ((6.0, 5.0), (7.0, 5.0), (7.0, 7.4), (6.0, 7.4))
    lower, upper = StoreyPlan(plan=flat, openings=(stairs,)), StoreyPlan(plan=flat)
    house = make_storeys(StoreysPlan(name="house", storeys=(lower, upper)))
    tx, rx = points(flat)
    rx = np.concatenate([rx[:30], rx[:30] + np.array([0.0, 0.0, house.storeys[1].floor_m])])
    return {"paths": paths_digest(wireless.Tracer(house, frequency_hz=28e9).trace(tx, rx))}


def trace_mesh() -> dict[str, str]:
    """Traces in space, in a furnished room of many triangles."""
    import trimesh

    import wireless

    room = trimesh.creation.box((8, 6, 3))
    for k in range(12):
        box = trimesh.creation.box((0.6, 0.4, 0.5 + 0.1 * k))
        box.apply_translation((-3.2 + 0.55 * k, 1.5 * (-1) ** k, -1.5 + (0.5 + 0.1 * k) / 2))
        room = trimesh.util.concatenate([room, box])
    for _ in range(4):
        room = room.subdivide()
    rng = np.random.default_rng(0)
    tx, rx = np.array([[3.0, 2.5, 0.5]]), rng.uniform((-3.5, -2.5, 0.0), (3.5, 2.5, 1.2), (40, 3))
    config = wireless.TracerConfig(scene="space", max_reflections=2)
    return {str(len(room.faces)): paths_digest(wireless.Tracer(room, config=config).trace(tx, rx))}


def trace_mitsuba() -> dict[str, str]:
    """Traces of a scene file of Mitsuba."""
    import robosim
    import wireless

    building = robosim.make_building(robosim.read_plan("flat"))
    with tempfile.TemporaryDirectory() as folder:
        robosim.export_mitsuba(building, Path(folder, "scene.xml"))
        tracer = wireless.Tracer.from_mitsuba(Path(folder, "scene.xml"), frequency_hz=3.5e9)
        return {"paths": paths_digest(tracer.trace(*points(building.plan)))}


def points(plan: "object") -> tuple[np.ndarray, np.ndarray]:
    """A transmitter and sixty receivers on the free floor of a plan."""
    free = np.argwhere(plan.free)  # type: ignore[attr-defined]
    cells = free[np.random.default_rng(0).choice(len(free), 61, replace=False)]
    xy = plan.to_map(cells[:, ::-1] + 0.5)  # type: ignore[attr-defined]
    xyz = np.column_stack([xy, np.full(len(xy), 1.2)])
    return xyz[:1], xyz[1:]


def paths_digest(paths: "object") -> str:
    """Digest of all arrays of traced paths, and their number."""
    arrays = {key: value for key, value in vars(paths).items() if isinstance(value, np.ndarray)}
    whole = "".join(f"{key}{digest(arrays[key])}" for key in sorted(arrays))
    return f"{len(arrays['tx'])} paths, {hashlib.sha256(whole.encode()).hexdigest()[:12]}"


TRACES: dict[str, Callable[[], dict[str, str]]] = {
    "trace-plan": trace_plan,
    "trace-storeys": trace_storeys,
    "trace-mesh": trace_mesh,
    "trace-mitsuba": trace_mitsuba,
}


def main() -> None:
    """Print all digests as JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", default="", help="part of the names to compute")
    only = parser.parse_args().only
    work: dict[str, Callable[[], dict[str, str]]] = {
        **{
            f"episode-{name}": lambda words=words: run_command(f"episode {words}")
            for name, words in EPISODES.items()
        },
        **{name: lambda words=words: run_command(words) for name, words in COMMANDS.items()},
        **TRACES,
    }
    digests = {}
    for name, compute in work.items():
        if only in name:
            start = time.perf_counter()
            digests[name] = compute()
            print(f"{name}: {time.perf_counter() - start:.0f} s", file=sys.stderr)
    print(json.dumps(digests, indent=1, sort_keys=True))


if __name__ == "__main__":
    main()
