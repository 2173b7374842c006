"""Each benchmark runs at its smallest size, and its numbers are plausible. No bounds on times."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.building.mesh_export import export_mitsuba
from robosim.datasets.link_units import LinkSetConfig
from robosim.datasets.links import make_dataset
from robosim.episode_config import EpisodeConfig
from robosim.evaluation.episodes import scene
from robosim.evaluation.suite import Suite, draw_tasks, write_suite
from robosim.plans.files import write_ros
from robosim.plans.storey_plans import StoreyPlan, StoreysPlan
from tests.benchmarks import (
    belief,
    blockage,
    edges,
    endurance,
    environment,
    episode,
    estimation,
    exploration,
    labels,
    leaks,
    link_states,
    map_errors,
    mapping,
    physics,
    plans,
    render,
    robots,
    team_coverage,
    team_search,
    tracer_peer,
    tracing,
)
from tests.benchmarks.__main__ import BENCHMARKS, main
from tests.benchmarks.harness import Options
from tests.benchmarks.mapping import Settings
from tests.benchmarks.results import Results
from tests.plans import two_rooms
from wireless import Tracer, TracerConfig


@pytest.fixture
def pair(tmp_path) -> str:
    """A file with two rooms."""
    write_ros(two_rooms(0.8), tmp_path / "pair.yaml")
    return str(tmp_path / "pair.yaml")


@pytest.fixture
def options(tmp_path) -> Options:
    return Options(out=tmp_path / "out")


def column(results, table, name):
    """Values of a column by their rows."""
    return {
        row["row"]: row.get("value") for row in results.rows if (row["table"], row["name"]) == (table, name)
    }


def test_tracing(pair, options, monkeypatch):
    """The fullest setting agrees with itself; rays find all paths, and none that is false."""
    plan = StoreyPlan(plan=two_rooms(0.8))
    opened = replace(plan, openings=(((0.4, 0.4), (1.4, 0.4), (1.4, 1.4), (0.4, 1.4)),))
    monkeypatch.setattr(tracing, "three_villas", lambda: StoreysPlan(name="two", storeys=(opened, plan)))
    monkeypatch.setattr(tracing, "JUDGED", tracing.Room(3, 1, 1))
    monkeypatch.setattr(tracing, "ROOMS", (tracing.Room(1, 0, 0),))
    monkeypatch.setattr(tracing, "SINGLE", 2)
    results = tracing.main((pair,), receivers=40, rooms=1, options=options)
    same = column(results, "interactions", "same link state")
    without_edges = [same[f"two rooms, {n} reflections"] for n in range(5)]
    assert without_edges == sorted(without_edges) and without_edges[0] < without_edges[-1] < 100
    assert same["two rooms, 4 reflections and an edge"] == 100
    assert set(column(results, "rooms", "found").values()) == {100}
    found = list(column(results, "rays", "found").values())
    assert found == sorted(found) and found[-1] == 100
    assert set(column(results, "rays", "false").values()) == {0}
    row = "6 links traced in space too"
    assert results.find("storeys", row, "paths in both")["value"] > 6
    assert results.find("storeys", row, "in space alone")["value"] == 0
    assert results.find("storeys", row, "in storeys alone")["value"] == 0
    sight = column(results, "scattering", "line of sight")
    assert all(abs(change) < 0.2 for change in sight.values())
    assert (options.out / "space.png").stat().st_size > 10_000


def test_blockage(pair, options, monkeypatch):
    """A person of 0.3 m at 1.2 m/s fades 250 ms (200 to 320), by more than 10 dB at 73.5 GHz; the crowd takes time.

    The exact loss behind a body grows towards the antenna, and is at most 7 dB off that of screens in the middle.
    """
    monkeypatch.setattr(blockage, "CROSSED_M", np.array([1.0, 2.5]))
    monkeypatch.setattr(blockage, "NEAR_M", (0.5, 2.5))
    results = blockage.main(pair, links=2, turns=1, options=options)
    duration_ms = column(results, "fades", "duration")
    assert all(200 < value < 320 for row, value in duration_ms.items() if "published" not in row)
    assert results.find("fades", "73.5 GHz, knife-edges", "mean loss")["value"] > 10
    one, two = (
        results.find("fades", f"60 GHz, model-b{people}", "loss behind")["value"]
        for people in ("", ", two people")
    )
    assert 1.7 * one < two < 2.3 * one
    exact = column(results, "body", "skin, upright electric field")
    assert exact["28 GHz, 0.5 m"] > exact["28 GHz, 2.5 m"] + 5
    for law in ("knife-edges", "model-b"):
        assert 0 < exact["28 GHz, 2.5 m"] - column(results, "body", law)["28 GHz, 2.5 m"] < 7
    assert results.find("time", "two rooms, 25 paths, 10 persons", "model-b")["value"] > 0
    assert (options.out / "blockage.png").stat().st_size > 10_000


def test_estimation(pair, options, monkeypatch):
    """Ours is within 4.8 dB of the bound at 40 dB (15 links: 3 standard deviations); at 10 dB nothing is found."""
    monkeypatch.setattr(estimation, "SNRS_DB", (10.0, 40.0))
    monkeypatch.setattr(estimation, "BY_WAVEFORM", 1)
    results = estimation.main((pair,), links=60, options=options)
    assert results.find("lone paths", "10 dB", "sage")["value"] > 90
    strong = results.find("lone paths", "40 dB", "sage")
    assert abs(20 * np.log10(strong["value"] / strong["bar"])) < 4.8
    assert 0.3 < results.find("lone paths", "40 dB", "pca")["value"] < 1.2
    near = column(results, "arrivals", "line of sight")
    assert near["strongest path, sage: within 10°"] > 80
    assert min(column(results, "speed", "links a CPU second").values()) > 0


def test_render(pair, options):
    """Depth of each camera that draws here is right to 1 mm + 0.1 %; the judge is checked in the tests of cameras."""
    results = render.main(pair, sizes=(48,), warm_up=2, turns=2, options=options)
    error = column(results, "cameras", "mean error")
    assert {"robosim, 48 x 48", "Embree, 48 x 48"} <= set(error)
    assert all(0 < value < 1 for row, value in error.items() if row.startswith(("robosim", "Embree")))
    assert results.find("cameras", "robosim, 48 x 48", "times ours")["value"] == 1


def test_physics(pair, options):
    """The kinematic twin is exact, MuJoCo errs by at most 0.3 mm at 5 ms, and walls hold in both."""
    results = physics.main((pair,), legs=2, options=options)
    error = column(results, "driving", "error of a motion")
    assert error["two rooms, kinematic"] < 1e-9
    assert 0 < error["two rooms, MuJoCo 5 ms"] < 0.3
    assert max(column(results, "driving", "by the outline").values()) < 5


def test_episode(pair, options):
    """Six decisions of the oracle in all settings; what is measured is not measured again."""
    first = episode.main((pair,), goal="oracle", targets=1, max_steps=6, options=options)
    steps = column(first, "searches", "relative steps")
    assert len(steps) == 10 and steps["default"] == 1
    again = episode.main((pair,), goal="oracle", targets=1, max_steps=6, options=options)
    assert again.rows == first.rows


@pytest.mark.usefixtures("in_process")
def test_belief(pair, options):
    """Thirty decisions: all kinds of belief count the same measurements, and one that knows nothing is the worst."""
    results = belief.main((pair,), goal="snr", targets=1, max_steps=30, options=options)
    cases = {row["row"]: row["cases"] for row in results.rows if row["name"] == "within 1 m"}
    assert len(cases) == 5 and len(set(cases.values())) == 1
    density = column(results, "density", "mean of searches")
    assert min(density, key=density.get) == "no measurement"


@pytest.mark.usefixtures("in_process")
def test_exploration(pair, options):
    results = exploration.main(
        (pair,),
        explorers=("nearest", "gain"),
        mapper="classical",
        physics="kinematic",
        max_steps=40,
        options=options,
    )
    assert set(column(results, "driving", "area under the curve")) == {"nearest", "gain"}
    assert all(20 < seen <= 100 for seen in column(results, "driving", "seen after 1000").values())
    assert results.find("driving", "nearest", "over nearest")["value"] == 0


@pytest.mark.usefixtures("in_process")
def test_mapping(options):
    """Floors are turned, parts left out, and radios received; each method has scores."""
    settings = Settings(steps=6, transmitters=2)
    results = mapping.main(("ring",), turned=(0.0, 30.0), settings=settings, options=options)
    assert set(column(results, "plans", "ATE")) == {"ring", "ring@30"}
    assert {"with radio of 1", "with radio of 2", *mapping.LEFT_OUT} <= set(
        column(results, "poses", "ATE, median")
    )
    assert all(0 < value <= 1 for value in column(results, "maps", "iou seen").values())


def test_endurance(pair, options):
    """200 decisions: every number is finite, the pose is never off by 0.2 m, and in the end the map does not grow."""
    results = endurance.main(pair, settings=Settings(steps=200), options=options)
    assert set(column(results, "endurance", "not finite").values()) == {0}
    assert max(column(results, "endurance", "largest").values()) < 20
    assert len(set(list(column(results, "endurance", "cells of the map").values())[7:])) == 1


def test_robots(pair, options):
    """A task each: every robot arrives, and the rectangles pass a door 4 cm wider."""
    results = robots.main([pair], tasks=1, options=options)
    assert max(column(results, "drives", "arc, place").values()) < 1
    assert set(column(results, "tasks", "arrived").values()) == {100}
    assert set(column(results, "doors", "arrived").values()) == {100}


def test_environment(pair, options, monkeypatch):
    """A finer grid of a radio table is not worse, and takes longer; the nearest node alone is worse."""
    monkeypatch.setattr(environment, "SECONDS", 0.01)
    monkeypatch.setattr(environment, "CASES", dict(list(environment.CASES.items())[:1]))
    monkeypatch.setattr(environment, "PEERS", {})
    monkeypatch.setattr(environment, "MEASURED", 4)
    results = environment.main(pair, robots=2, links=40, options=options)
    turn = column(results, "radio tables", "direction, 90 %")
    assert turn["0.1 m"] <= turn["0.5 m"]
    assert turn["0.1 m"] <= turn["0.1 m, nearest node"]
    assert len(column(results, "environments", "2 robots")) == 1


def test_plans(pair, options):
    """Few generated homes are like two rooms in no statistic entirely."""
    results = plans.main((pair,), count=2, options=options)
    assert all(0 < distance <= 1 for distance in column(results, "statistics", "distance").values())


def test_link_states(options, tmp_path):
    """Shipped classifiers are right in most links of two rooms; a training's score is the mean over its buildings."""
    make_dataset([two_rooms(0.8)], LinkSetConfig(tx_per_plan=1, grid_m=0.4), tmp_path / "links")
    folds = {"fold0": {"accuracy_by_building": {"a": 0.9, "b": 0.7}}, "mean_accuracy": 0.5}
    (tmp_path / "ours").mkdir()
    (tmp_path / "ours" / "result.json").write_text(json.dumps({"validation": folds}))
    results = link_states.main((tmp_path / "links", tmp_path / "ours"), options=options)
    assert min(column(results, "shipped", "links").values()) > 80
    assert results.find("trained", "ours", "right")["value"] == pytest.approx(80)


def test_published_data(shared, options, tmp_path):
    """One building with one transmitter: 97 % of all links and 98 % of those in the clear."""
    data, maps = tmp_path / "data" / "Hominy", shared / "maps" / "gibson" / "train"
    data.mkdir(parents=True)
    for name in ("Hominy_tx_pos.csv", "Hominy_Tx_8_beam_search.csv"):
        (data / name).write_bytes((shared / "data" / "mmwrobotnav" / "Hominy" / name).read_bytes())
    results = labels.main(data.parent, maps, options=options)
    whole = results.find("agreement", "all", "same link state")
    assert whole["cases"] == 1351 and whole["value"] > 96.5
    assert results.find("agreement", "all", "in the clear")["value"] > 97.5
    assert results.find("agreement", "all", "line of sight: direction within 5°")["value"] > 94
    assert json.loads((options.out / "labels.json").read_text())["command"].startswith(
        "python -m tests.benchmarks"
    )


def test_published_edges(shared, options):
    """Six transmitters: lone diffractions spread less about the bisector's law than about our default."""
    data = shared / "data" / "mmwrobotnav"
    cases = [
        edges.cases_of(
            data, shared / "maps" / "gibson" / "train" / "Kerrtown.glb_topdownmap.out", "Kerrtown", number
        )
        for number in (1, 2, 3)
    ]
    results = edges.judge(edges.Cases.joined(cases))
    spread = {
        name: np.ptp(results.find("laws", name, "all")["spread"])
        for name in ("bisector", "nearer face (default)")
    }
    assert spread["bisector"] < spread["nearer face (default)"]
    assert abs(results.find("laws", "bisector", "all")["value"]) < 3


def test_tracer_peer_without_the_peer_is_skipped(pair, options, capsys):
    assert not tracer_peer.main((pair,), python="no-such-python", options=options).rows
    assert "tracer_peer is skipped: no-such-python has no Sionna RT" in " ".join(
        capsys.readouterr().out.split()
    )


def test_tracer_peer_counts_paths_of_both(tmp_path, monkeypatch):
    """A peer that finds what we find, but for one reflection, and 0.5 dB stronger."""
    scene = export_mitsuba(make_building(two_rooms(0.8)), tmp_path)

    def peer(python, scene, tx, rx, order, samples, frequency_hz):
        config = TracerConfig(max_reflections=1, floor_ceiling=True, diffraction=False, max_transmissions=0)
        paths = Tracer.from_mitsuba(scene, frequency_hz=frequency_hz, config=config).trace(tx, rx)
        table = {name: np.full((len(rx), 30), np.nan) for name in ("delay_s", "power", "turns")}
        power = 10**0.05 * np.abs(paths.gain[:, 0, 0]) ** 2
        for name, value in (("delay_s", paths.delay_s), ("power", power), ("turns", paths.order)):
            table[name][paths.rx, paths.rank] = value
        first = np.flatnonzero(paths.order == 1)[0]
        table["power"][paths.rx[first], paths.rank[first]] = np.nan
        return {f"{name}_{samples[0]}": value for name, value in table.items()}

    monkeypatch.setattr(tracer_peer, "_run_worker", peer)
    results = Results()
    tracer_peer.measure_scene(scene, "python", 20, 0, results)
    found = {row["name"]: row["value"] for row in results.rows}
    assert found["line of sight: both"] > 0 and found["reflections: both"] > 5
    assert [found[f"{kind}: here alone"] for kind in ("line of sight", "reflections")] == [0, 1]
    assert [found[f"{kind}: there alone"] for kind in ("line of sight", "reflections")] == [0, 0]
    assert found["confirmed"] == 1 and found["there twice"] == 0
    assert found["strength, 95 % within"] == pytest.approx(0.5)


def test_map_errors_of_a_peer_that_is_1_db_stronger(tmp_path, monkeypatch):
    """It has an error of 1 dB; more points of a cell leave less, a map of all orders reaches all cells."""

    def peer(cells, python, samples):
        dense, _ = map_errors.own_powers(cells, tracer_peer.specular(4, 100), map_errors.DENSE)
        return {"version": "2", "gain_1000": 10**0.1 * dense.mean(axis=2), "cpu_s_1000": 1.0}

    monkeypatch.setattr(map_errors, "ask_peer", peer)
    results = Results()
    map_errors.measure(map_errors.of_plan(two_rooms(0.8), 0.5, 0, tmp_path), "python", (1000,), results)
    error = column(results, "two rooms", "error")
    assert error["Sionna RT 2, 1e3 samples"] == pytest.approx(1.0, abs=1e-3)
    points = [error[f"all paths, order 4{end}"] for end in ("", ", 4 points", ", 9 points")]
    assert points == sorted(points, reverse=True)
    missed = column(results, "two rooms", "not reached")
    assert missed["all paths, order 4, 9 points"] == 0 <= missed["all paths, order 1"]
    figure = map_errors.draw(results)
    assert [len(line.get_xdata()) for line in figure.axes[0].lines] == [4, 4, 3, 1]


def test_tracer_peer_confirms_true_reflections_only():
    """On the ground: the mirror point, but not one next to it, above it, or behind a wall."""
    ground = np.array([[[-9.0, -9, 0], [9, -9, 0], [0, 9, 0]]])
    wall = np.array([[[1.0, -5, -1], [1, 5, -1], [1, 0, 5]]])
    tx, rx = np.array([-2.0, 0, 1]), np.array([2.0, 0, 1])
    is_reflection = tracer_peer.is_reflection
    assert is_reflection(ground, tx, np.zeros(3), rx)
    assert not is_reflection(ground, tx, np.array([0.1, 0, 0]), rx)
    assert not is_reflection(ground, tx, np.array([0, 0, 0.1]), rx)
    assert not is_reflection(np.concatenate([ground, wall]), tx, np.zeros(3), rx)


def test_the_list_names_all_benchmarks(capsys):
    """--help of the whole has a line for each; an unknown one ends with status 2."""
    with pytest.raises(SystemExit):
        main(["--help"])
    printed = capsys.readouterr().out
    assert all(name in printed for name in BENCHMARKS)
    with pytest.raises(SystemExit) as ended:
        main(["nothing"])
    assert ended.value.code == 2


def test_team_coverage(pair, options):
    """Two robots see two rooms sooner than one does, and what both saw is a part of it."""
    exchanges = ("perfect", "none")
    results = team_coverage.main((pair,), sizes=(2,), exchanges=exchanges, max_steps=200, options=options)
    rows = results.tables()["pair"][1:]
    assert [row[0] for row in rows] == ["1 robot", "2 robots, perfect", "2 robots, none"]
    decisions, overlap = column(results, "pair", "decisions"), column(results, "pair", "overlap")
    assert 0 < decisions["2 robots, perfect"] <= decisions["1 robot"] < 200
    assert 0 <= overlap["2 robots, perfect"] <= overlap["2 robots, none"] <= 100


def test_team_search(pair, options, tmp_path):
    """Two robots arrive in two rooms; the ratio is that of the searches, and homes have hard tasks only."""
    suites = []
    for name, count in (("campus", 1), ("homes", 3)):
        hull_m = EpisodeConfig().simulator.robot.hull_m
        places = scene(Path(pair), "auto", EpisodeConfig().building, hull_m)[1]
        suite = Suite(plans={"pair": Path(pair)}, tasks=tuple(draw_tasks("pair", places, count, 0)))
        suites.append(tmp_path / f"{name}.yaml")
        write_suite(suite, suites[-1])
    results = team_search.main(*suites, sizes=(2,), tasks=(0,), max_steps=300, options=options)
    for table in ("campus", "homes"):
        assert column(results, table, "arrived") == {"1 robot": 100, "2 robots": 100}
        ratio = results.find(table, "2 robots", "steps over one")
        assert ratio["cases"] == 1 and 0 < ratio["value"] < 3


def test_leaks(options):
    """A visitor who comes when another leaves adds nothing; of a closed page Python's resource tracker remains."""
    pytest.importorskip("viser")
    results = leaks.main(episodes=2, steps=5, visits=3, at_once=2, options=options)
    assert column(results, "episodes", "decisions") == {"1": 5, "2": 10}
    for name, left in (("descriptors", 3), ("threads", 0), ("processes", 1), ("temporary files", 0)):
        before, during = column(results, "episodes", name), column(results, "visitors", name)
        assert before["1"] == before["2"]
        assert during["2"] == during["3"]
        assert during["page closed"] <= before["2"] + left
