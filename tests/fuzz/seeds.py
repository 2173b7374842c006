"""Good files of every kind that robosim reads, small ones, made by what writes them; the fuzzer damages copies.

A seed is a folder, since many readers look at several files: a map and its image, weights and their card, all of an
evaluation. Where there are real maps and measurements in ../shared, some of them are seeds too.
"""

import json
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from rich.console import Console
from safetensors.numpy import save

from robosim.building.building import make_building
from robosim.building.mesh_export import export_mesh
from robosim.datasets.collect import CollectConfig
from robosim.datasets.link_units import transmitters_file
from robosim.environments.collect import CollectSearchesConfig, collect_searches
from robosim.episode_config import EpisodeConfig
from robosim.evaluation.evaluate import settings_of
from robosim.evaluation.suite import Suite, SuiteTask, write_suite
from robosim.layers import Layer
from robosim.plans.files import write_png, write_ros
from robosim.plans.floorplan import FREE, OCCUPIED, FloorPlan
from robosim.plans.formats.plan_image import GREY, encode_pgm
from robosim.plans.furnishings.pieces import make_piece
from robosim.policies.reason import ARRIVAL
from robosim.policies.search_network import initial_weights as search_weights
from robosim.radio.table import RadioTable
from robosim.recording.episode_file import EPISODE, EpisodeWriter, Head
from robosim.support.files import plain, write_files, write_json, write_whole
from robosim.support.installation import assets_dir, is_installed, shipped_network
from robosim.support.parts import to_dict
from robosim.support.run_folder import SETTINGS
from robosim.team.team_config import TeamConfig
from slam.grid import GridFrame, MapEstimate
from tests import stored_episodes
from tests.fuzz.bag_seeds import bags
from tests.fuzz.checkpoint_seeds import checkpoints
from tests.fuzz.robot_seeds import logs, robots, scenes
from tests.fuzz.small_files import write_files as write_small_files
from tests.fuzz.trees import CANARY
from tests.plans import two_rooms
from tests.robosim.plans.formats import test_polygons
from tests.steps import measurement, step
from wireless.estimates import PathEstimates
from wireless.formats.link_records import link_table, write_links
from wireless.formats.mmwrobotnav_csv import estimated_csv
from wireless.paths import LinkState, Paths
from wireless.tracing.tracer import Tracer

SHARED = Path(__file__).resolve().parents[3] / "shared"
TARGET, POLICIES = (5.0, 2.0), ("oracle", "snr", "los-or-first")


def make_seeds(folder: Path) -> list[str]:
    """Write all seeds, each into a folder of its own; returns what could not be made, in words."""
    for make in (
        ros_maps, storeys, images, plans, meshes, weights, episode, evaluation, shards, links, measurements,
        checkpoints, arrays, logs, robots, furnishings, dialects, coloured, configurations, radio_tables, searches,
        bags, scenes, drawings, small, models,
    ):  # fmt: skip
        make(folder)
    if not SHARED.is_dir():
        return ["no seeds of real maps and measurements: there is no ../shared"]
    real(folder)
    return []


def _into(folder: Path, name: str) -> Path:
    (folder / name).mkdir(parents=True, exist_ok=True)
    return folder / name


def small_plan() -> FloorPlan:
    """A room of 3 m by 2 m with a wall in it."""
    cells = np.full((40, 60), FREE, np.uint8)
    cells[:, :2] = cells[:2] = cells[20:, 30:33] = OCCUPIED
    return FloorPlan(occupancy=cells, resolution_m=0.05, origin=(-1.0, 2.0, 0.3), name="small")


def ros_maps(folder: Path) -> None:
    """A map and its image, in both forms; one with everything that a map can say."""
    write_ros(small_plan(), _into(folder, "ros-pgm") / "map.yaml")
    write_ros(small_plan(), _into(folder, "ros-png") / "map.yaml", image="png")
    rich = _into(folder, "ros-rich") / "map.yaml"
    write_ros(small_plan(), rich)
    text = rich.read_text().replace("trinary", "scale").replace("negate: 0", "negate: 1")
    rich.write_text(text + "wall_line: cell_centre\neroded_m: 0.1\nname: rich\n")


def storeys(folder: Path) -> None:
    """A building of two storeys over each other."""
    home = _into(folder, "storeys")
    write_ros(small_plan(), home / "map.yaml")
    (home / "building.yaml").write_text(
        "name: house\nstoreys:\n- {plan: map.yaml, height: 2.6, slab: 0.25, material: concrete, offset: [0.0, 0.0],\n"
        "   openings: [[[-0.5, 3.0], [0.0, 3.0], [0.0, 3.5], [-0.5, 3.5]]]}\n"
        "- {plan: map.yaml, material: wall.yaml}\n"
    )
    (home / "wall.yaml").write_text("layers:\n- {material: glass, thickness_m: 0.006}\n")


def images(folder: Path) -> None:
    """Images of every format and depth."""
    grey = GREY[small_plan().occupancy]
    colour = np.dstack([grey, grey, grey, np.full_like(grey, 255)])
    home = _into(folder, "images")
    write_png(small_plan(), home / "grey.png")
    (home / "raw.pgm").write_bytes(encode_pgm(grey))
    rows = b"\n".join(b" ".join(b"%d" % v for v in row) for row in grey)
    (home / "text.pgm").write_bytes(b"P2\n# comment\n60 40\n255\n" + rows)
    (home / "deep.pgm").write_bytes(b"P5 60 40 65535 " + (grey.astype(">u2") * 257).tobytes())
    for name, pixels in {
        "colour.png": colour, "palette.gif": grey, "a.bmp": grey, "a.tif": grey, "a.jpg": grey, "a.webp": colour,
        "a.ppm": colour[..., :3], "deep.png": grey.astype(np.uint16) * 257, "one.pbm": grey > 100,
    }.items():  # fmt: skip
        Image.fromarray(pixels).save(home / name)
    Image.fromarray(colour).save(home / "packed.tiff", compression="tiff_lzw")
    import cv2

    cv2.imwrite(str(home / "deep-colour.png"), colour.astype(np.uint16) * 257)


def plans(folder: Path) -> None:
    """A top-down grid, a house, arrays."""
    home = _into(folder, "plans")
    cells = (small_plan().occupancy == FREE).astype(int)
    (home / "grid.out").write_text("\n".join(",".join(map(str, row)) for row in cells))
    np.savetxt(home / "saved.out", cells, delimiter=",")
    house = {
        "id": "a",
        "verts": [[0, 0], [2.5, 0], [2.5, 1], [1.2, 1.4], [0, 1.5]],
        "room_category": {"Hall": [[0, 0, 1, 1]]},
    }
    (home / "house.json").write_text(json.dumps(house))
    np.save(home / "probability.npy", 1.0 - cells)
    np.save(home / "states.npy", small_plan().occupancy)
    np.save(home / "truth.npy", cells == 0)


def meshes(folder: Path) -> None:
    """A building in every format of meshes; glTF with its data next to it and within."""
    home, building = _into(folder, "meshes"), make_building(small_plan())
    for suffix in (".glb", ".ply", ".obj", ".stl"):
        export_mesh(building, home / f"a{suffix}")
    mesh = trimesh.load_mesh(home / "a.stl")
    (home / "a.off").write_text(mesh.export(file_type="off"))
    (home / "text.ply").write_bytes(mesh.export(file_type="ply", encoding="ascii"))
    (home / "text.stl").write_text(mesh.export(file_type="stl_ascii"))
    box = trimesh.load(home / "a.glb")
    for name, content in box.export(file_type="gltf", merge_buffers=True).items():
        path = _into(folder, "gltf") / name.replace("model", "a")
        path.write_bytes(content)


def dialects(folder: Path) -> None:
    """Meshes as other programs write them: polygons, relative indices, byte orders, quantised and mirrored scenes."""
    home = _into(folder, "dialects")
    (home / "relative.obj").write_text(
        test_polygons.obj(lambda i, n: f"{i - n}/{i - n}", head="mtllib no.mtl\nusemtl brick\nvt 0 0\n")
    )
    (home / "colours.obj").write_bytes(test_polygons.obj(newline="\r\n", colour=" 0.5 0.5 0.5").encode())
    for kind in ("ascii", "binary_little_endian", "binary_big_endian"):
        (home / f"{kind}.ply").write_bytes(test_polygons.ply(kind, extra=True, scalar="double", index="uint"))
    corners = "".join(f"{x} {y} {z} 255 0 0 255\n" for x, y, z in test_polygons.VERTICES)
    polygons = "".join(f"{len(face)} {' '.join(map(str, face))} 0.5\n" for face in test_polygons.faces())
    (home / "colours.off").write_text(f"# by hand\nCOFF\n12 8 0\n{corners}{polygons}")
    (home / "loud.stl").write_bytes(test_polygons.stl(binary=False, newline="\r\n").upper())
    (home / "named.stl").write_bytes(test_polygons.stl(name="solid by a program"))
    nodes = [{"children": [1], "scale": [2, 2, 2]}, {"mesh": 0, "scale": [0.5, -0.5, 0.5]}]
    (home / "mirrored.gltf").write_text(json.dumps(test_polygons.gltf(nodes=nodes)))
    (home / "quantised.glb").write_bytes(
        test_polygons.glb(test_polygons.gltf(5123, True, {"scale": [12.0] * 3}))
    )


def small(folder: Path) -> None:
    """A small file of each kind that commands read."""
    write_small_files(folder / "small")


def coloured(folder: Path) -> None:
    """A ROS map whose colours are materials, one of them a file of layers."""
    home, grey = _into(folder, "ros-materials"), GREY[small_plan().occupancy]
    picture = np.dstack([grey, grey, grey])
    picture[20:, 30:33], picture[:, 0] = (0, 0, 255), (128, 0, 0)
    Image.fromarray(picture).save(home / "map.png")
    (home / "map.yaml").write_text(
        "image: map.png\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\n"
        "free_thresh: 0.196\nmaterials: {'#0000ff': glazing, '#800000': map-wall.yaml}\n"
    )
    (home / "map-wall.yaml").write_text("name: clad\nlayers:\n- {material: glass, thickness_m: 0.006}\n")


def configurations(folder: Path) -> None:
    """The result of an episode of a team, whose configuration another may start from."""
    team = TeamConfig(robots="jackal,turtlebot4", lose=("2@9",))
    write_json(_into(folder, "config") / "result.json", {"config": to_dict(EpisodeConfig(team=team))})


def radio_tables(folder: Path) -> None:
    """Radio paths at all nodes of a room."""
    building = make_building(small_plan())
    table = RadioTable.trace(
        building, Tracer(building, frequency_hz=28e9), np.array([-0.5, 2.5, 1.5]), step_m=0.5
    )
    table.write(_into(folder, "radio-table") / "table.parquet")


#: How the searches are collected.
SEARCHES = CollectSearchesConfig(plan="flat", episodes=1, observe=("pose",), targets=1, most_steps=4)


def searches(folder: Path) -> None:
    """A collected search, whose metadata name code as the environment: it runs if a space is missing, say."""
    try:
        data = collect_searches(SEARCHES, _into(folder, "searches"), Console(quiet=True))
    except ImportError:  # Minari is an extra
        shutil.rmtree(folder / "searches")
        return
    metadata = json.loads((data / "metadata.json").read_text())
    spec = {**json.loads(metadata["env_spec"]), "entry_point": CANARY}
    write_json(data / "metadata.json", {**metadata, "env_spec": json.dumps(spec)})


def weights(folder: Path) -> None:
    """Those that come with the package."""
    for name in ("mapper", "explorer"):
        home = _into(folder, f"weights-{name}")
        for suffix in (".safetensors", ".json"):
            shutil.copyfile(shipped_network(name).with_suffix(suffix), home / f"a{suffix}")
    search = save(search_weights(np.random.default_rng(0)))
    (_into(folder, "weights-search") / "a.safetensors").write_bytes(search)
    for suffix in (".safetensors", ".json"):
        source = assets_dir() / "weights" / f"link-state-generated{suffix}"
        shutil.copyfile(source, _into(folder, "weights-link-state") / f"a{suffix}")


def _estimate(shape=(12, 16)) -> MapEstimate:
    rng = np.random.default_rng(0)
    return MapEstimate(
        frame=GridFrame(origin_xy=(0.0, 0.0), shape=shape),
        obstacle_probability=rng.choice(np.float32([0.1, 0.5, 0.9]), shape),
        explored=rng.random(shape) < 0.5,
        blocked=rng.random(shape) < 0.02,
        pose=np.zeros(3),
    )


RINGS = [np.array([[0.0, 0], [6, 0], [6, 3], [0, 3]]), np.array([[2.0, 1], [3, 1], [3, 2]])]


def episode(folder: Path) -> None:
    """A recorded episode of five steps, whose map grows, with radio and belief."""
    rng, writer = np.random.default_rng(1), EpisodeWriter(RINGS)
    for i in range(5):
        frame = GridFrame(origin_xy=(-0.05 * i, 0.0), shape=(20, 20 + 2 * i))
        around = GridFrame(origin_xy=(0.0, 0.0), resolution_m=0.2, shape=(7, 9))
        pose = (1.0 + 0.1 * i, 1.0, 0.1)
        writer.add(
            step(
                i,
                pose=pose,
                map=Layer(frame, rng.integers(0, 20, frame.shape, np.uint8)),
                belief=None if i < 2 else Layer(around, rng.integers(0, 64, (7, 9), np.uint8)),
                measured=None
                if i == 2
                else measurement(pose, LinkState.LOS, rng.uniform(-3, 3, 2), (30, 10)),
                rgb=rng.integers(0, 256, (16, 16, 3), np.uint8),
                depth=rng.integers(0, 9000, (16, 16)).astype(np.float32) / np.float32(1000),
                goal=TARGET,
                path=rng.uniform(0, 3, (i, 2)),
                reason=ARRIVAL,
                state=LinkState.OUTAGE,
            )
        )
    row = stored_episodes.row("pair", 0, "fused", TARGET, steps=5)
    of_one, of_team = (
        writer.content(Head(row=each, seeks_target=True), np.ones(3), 0.5, _estimate(), np.arange(6.0))
        for each in (row, {**row, "robots": 2})
    )
    write_whole(_into(folder, "episode") / EPISODE, of_one)
    for name, content in (("exported", of_one), ("team/robot1", of_team), ("team/robot2", of_team)):
        write_whole(_into(folder, name) / EPISODE, content)
        write_json(folder / name / "result.json", {"config": to_dict(EpisodeConfig()), "plan": "pair"})


def _episode(task: int, policy: str, steps: int) -> bytes:
    writer = EpisodeWriter(RINGS, pictures=False)
    for i, at in enumerate(np.linspace([1.0, 0.6], TARGET, steps)):
        link = measurement((*at, 0.5), LinkState.FIRST_ORDER, [0.1], [20.0]) if policy != "oracle" else None
        state = None if policy == "oracle" else LinkState.HIGHER_ORDER
        writer.add(step(i, pose=(*at, 0.5), goal=at + 0.6, measured=link, state=state, reason=ARRIVAL))
    row = stored_episodes.row("pair", task, policy, TARGET, steps=steps)
    timing = {"wall": 1.0, "decisions_per_s": 9.0}
    head = Head(row=row, seeks_target=True, timing=timing, made_by="0123")
    return writer.content(head, np.array([*TARGET, 0.5]), 0.5, _estimate(), np.arange(steps + 1.0))


def evaluation(folder: Path) -> None:
    """All that `robosim evaluate` leaves to go on from, and the suite."""
    home = _into(folder, "evaluation")
    write_ros(two_rooms(0.8), home / "plans" / "pair.yaml")
    tasks = tuple(
        SuiteTask(plan="pair", number=i, start=(1.0, 0.6, 9.0 * i), target=TARGET) for i in range(2)
    )
    suite = Suite(plans={"pair": home / "plans" / "pair.yaml"}, tasks=tasks, seed=3)
    write_suite(suite, home / "suite.yaml")
    write_suite(suite, home / "suite.json")
    write_json(home / SETTINGS, {"command": "evaluate", "settings": settings_of(suite, EpisodeConfig())})
    for task in range(2):
        for policy in POLICIES:
            path = home / "episodes" / "pair" / f"{task:03d}-{policy}-0.npz"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(_episode(task, policy, 20 + 9 * POLICIES.index(policy)))


#: How the frames are said to be collected.
COLLECTED = CollectConfig(homes=3, steps=3)


def shards(folder: Path) -> None:
    """Collected frames of three homes, and what says how they were collected."""
    home, rng, n = _into(folder, "shards"), np.random.default_rng(2), 3
    for i in range(3):
        np.savez_compressed(
            home / f"home-{i:05d}.npz",
            depth=rng.integers(0, 4000, (n, 32, 32), np.uint16),
            rgb=rng.integers(0, 256, (n, 32, 32, 3), np.uint8),
            action=np.array([-1, 0, 1], np.int8),
            odometry=rng.normal(size=(n, 3)).astype(np.float32),
            pose=rng.normal(size=(n, 3)),
            estimate=rng.normal(size=(n, 3)),
            belief=rng.integers(0, 256, (n, 64, 64), np.uint8),
            truth=rng.integers(0, 256, (n, 3, 64, 8), np.uint8),
        )
    kind = {key: value for key, value in asdict(COLLECTED).items() if key != "homes"}
    write_json(home / SETTINGS, {"command": "collect", "settings": plain(kind)})


def _paths() -> Paths:
    """Two transmitters, three receivers, up to two paths each."""
    tx, rx = np.array([0, 0, 0, 1, 1]), np.array([0, 0, 2, 1, 1])
    n, rng = len(tx), np.random.default_rng(3)
    kind = np.array([[0, 0], [1, 0], [2, 1], [0, 0], [1, 1]], np.uint8)
    order = (kind > 0).sum(axis=1).astype(np.uint8)
    gain = 1e-4 * rng.normal(size=(n, 2, 2)) * np.exp(1j)
    return Paths(
        tx_position=np.array([[1.0, 1, 1.5], [4, 2, 1.5]]), rx_position=rng.uniform(0, 3, (3, 3)),
        frequency_hz=28e9, tx=tx, rx=rx, gain=gain, power=np.abs(gain[:, 0, 0]) ** 2,
        delay_s=rng.uniform(1e-9, 9e-9, n), aoa_az=rng.uniform(-3, 3, n), aoa_el=rng.uniform(-1, 1, n),
        aod_az=rng.uniform(-3, 3, n), aod_el=rng.uniform(-1, 1, n), order=order, interaction=kind,
        primitive=np.where(kind > 0, 4, -1), point=np.where(kind[..., None] > 0, 1.0, np.nan).repeat(3, axis=2),
    )  # fmt: skip


def _estimates() -> PathEstimates:
    there, rng = np.arange(5) < np.array([2, 0, 5])[:, None], np.random.default_rng(4)
    angles = np.where(there, rng.uniform(-3, 3, (3, 5)), 0.0)
    snr = np.where(there, -np.sort(rng.uniform(-60, 20, (3, 5)), axis=1), -np.inf)
    return PathEstimates(
        aoa_rad=angles, aod_rad=angles, snr_db=snr, delay_s=1e-9 * angles, count=there.sum(axis=1)
    )


def links(folder: Path) -> None:
    """A data set of two transmitters, and radio paths."""
    home, cell = _into(folder, "dataset"), np.array([[0, 4], [1, 2], [3, 1]])
    (home / "links").mkdir()
    names = [f"links/pair_Tx_{tx + 1}.parquet" for tx in range(2)]
    for tx, name in enumerate(names):
        write_links(home / name, [link_table(_paths(), tx, _estimates(), cell, plan="pair")])
    write_json(
        home / "manifest.json", {"rows": 6, "units": [{"plan": "pair", "file": name} for name in names]}
    )
    _paths().write_parquet(_into(folder, "paths") / "paths.parquet")


def measurements(folder: Path) -> None:
    """Two transmitters as published."""
    home, cell = _into(folder, "measurements/pair"), np.array([[0, 4], [1, 2], [3, 1]])
    write_files(home, transmitters_file("pair", _paths().tx_position))
    for tx in (1, 2):
        state = np.array([1, 0, 3], np.uint8)
        content = estimated_csv(_estimates(), _paths().rx_position, state, cell, (4, 6))
        write_whole(home / f"pair_Tx_{tx}_beam_search.csv", content)


def arrays(folder: Path) -> None:
    """Arrays that runs leave for themselves."""
    home, rng = _into(folder, "arrays"), np.random.default_rng(6)
    np.savez(
        home / "home-1000220.npz",
        tokens=rng.normal(size=(4, 5, 5)).astype(np.float32),
        state=np.array([1, 2, 3, 1], np.uint8),
    )
    write_json(home / "bench.json", {"settings": {"seed": 1}, "rows": [{"plan": "a", "ate_m": 0.1}]})


def drawings(folder: Path) -> None:
    """A house in DXF, as text and binary, and in SVG, with everything that is read of them."""
    import ezdxf

    home, document = _into(folder, "drawings"), ezdxf.new("R2000")
    document.units = 6
    space, door = document.modelspace(), document.blocks.new("door")
    door.add_lwpolyline([(0, 0, 0, 0, 0.4), (1, 0.2)], dxfattribs={"const_width": 0.1})
    for corner in (0.0, 0.2):
        ends = (corner, 6 - corner, 4 - corner)
        corners = [(ends[0], ends[0]), (ends[1], ends[0]), (ends[1], ends[2]), (ends[0], ends[2])]
        space.add_lwpolyline(corners, close=True, dxfattribs={"layer": "WALL"})
    space.add_blockref("door", (2, 2), dxfattribs={"layer": "WALL", "rotation": 30})
    space.add_arc((3, 2), 1, 0, 90, dxfattribs={"layer": "WALL"})
    space.add_spline([(1, 1), (2, 3), (3, 1)], dxfattribs={"layer": "WALL"})
    space.add_ellipse((4, 1), (0.4, 0.1), 0.5, dxfattribs={"layer": "WALL"})
    space.add_hatch(dxfattribs={"layer": "WALL"}).paths.add_polyline_path([(1, 3), (2, 3), (2, 3.5)])
    document.saveas(home / "house.dxf")
    document.saveas(home / "binary.dxf", fmt="bin")
    (home / "house.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="600cm" height="400cm" viewBox="0 0 600 400">\n'
        "<style>.a{fill:#222}</style>\n"
        '<defs><g id="door"><path d="M0 0c10 20 30 20 40 0s9 9 20 5q5 5 9 1t3 3"/></g></defs>\n'
        '<g id="walls" transform="rotate(5) scale(0.9)"><path class="a" d="M0 0H600V400H0ZM20 20v360h560V20z"/>\n'
        '<use href="#door" x="100" y="50"/><circle cx="200" cy="200" r="30" style="stroke:#000;fill:none"/>\n'
        '<polyline points="100,100 200,150 300,100" stroke="black" stroke-width="8" fill="none"/>\n'
        '<path d="M300 200a30 20 15 1 0 40 30" stroke="rgb(0,0,9)"/></g></svg>\n'
    )


def models(folder: Path) -> None:
    """Building models of two storeys, in IFC 4 and IFC 2x3; none where ifcopenshell is missing, an extra."""
    if not is_installed("ifcopenshell"):
        return
    from tests.robosim.plans.formats.test_ifc import model

    home = _into(folder, "models")
    for version in ("IFC4", "IFC2X3"):
        model(version).write(str(home / f"{version.lower()}.ifc"))


def furnishings(folder: Path) -> None:
    """What is placed in a building, with meshes of every format next to it."""
    home = _into(folder, "furnishings")
    table = make_piece("table", at=(1.0, 1.0))
    entries = ["- {piece: chair, at: [2.0, 1.0], yaw_deg: 30, material: plywood, colour: [120, 90, 60]}"]
    for suffix in ("stl", "obj", "ply", "glb"):
        table.mesh.export(home / f"table.{suffix}")
        entries.append(
            f"- {{mesh: table.{suffix}, at: [2.0, 2.0], z_m: 0.1, unit_m: 0.5, name: one of {suffix}}}"
        )
    (home / "room.yaml").write_text("\n".join(entries) + "\n")
    write_ros(replace(two_rooms(0.8), furnishings=(table,)), _into(folder, "ros-furnished") / "map.yaml")


def real(folder: Path) -> None:
    """Maps and measurements that may not be shipped."""
    home = _into(folder, "real-ros")
    for name in ("turtlebot3.yaml", "turtlebot3.pgm"):
        shutil.copyfile(SHARED / "maps" / "ros" / name, home / name)
    home = _into(folder, "real-grid")
    grids = sorted((SHARED / "maps" / "gibson").glob("*/*.out"), key=lambda path: path.stat().st_size)
    shutil.copyfile(grids[0], home / grids[0].name)
    source = next(path for path in sorted((SHARED / "data" / "mmwrobotnav").iterdir()) if path.is_dir())
    home = _into(folder, f"real-measurements/{source.name}")
    for name in (f"{source.name}_tx_pos.csv", f"{source.name}_Tx_1_beam_search.csv"):
        lines = (source / name).read_text().splitlines()[:40]
        (home / name).write_text("\n".join(lines) + "\n")
