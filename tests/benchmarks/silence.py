"""Silence in large buildings: predicted and true reception of places, and the regions that it leaves.

A robot explores each building. Every few decisions it predicts of which random places of the floor it would receive
a transmitter (`RouteDirections.received`, on its map of that moment), and a measurement of one there answers. Places in
sight over seen floor are counted apart. Intervals are of 95 %, by bootstrap over buildings.

The prediction was fitted to generated buildings (decision record 41); none of the shared floors took part.
Reference: Niculescu-Mizil and Caruana, Predicting good probabilities with supervised learning, ICML 2005.
"""

import zlib
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from tyro.conf import OmitArgPrefixes, Positional

from robosim.building.building import Building, make_building
from robosim.building.reach import reach
from robosim.drawing.plots import explain, map_keys, plan_axes, wall_keys
from robosim.episode import run_episode
from robosim.episode_config import EpisodeConfig
from robosim.episode_log import EpisodeLog
from robosim.plans.floorplan import FloorPlan
from robosim.policies.regions import cells_of_regions
from robosim.policies.route_directions import MapSurvey
from robosim.policies.sightlines import in_sight
from robosim.radio.link import RadioLink
from robosim.simulator import SimulatorConfig
from robosim.step import Step
from robosim.task.tasks import make_task
from slam.exploration.frontiers import find_frontiers
from slam.grid import GridFrame, MapEstimate
from slam.planning.cost_map import CostConfig, cut_box, known_box, travel_time_from_robot
from tests.benchmarks.harness import DEFAULT, Options, figure_of, plans_of, ratio_interval, run_units
from tests.benchmarks.results import Results

#: Decisions between questions, and places that each is about, at most so far away [m].
EVERY, PLACES, FAR_M = 25, 40, 24.0
#: Side of the cells of a belief [m].
CELL_M = 0.2
#: Bounds of the classes of predictions.
BOUNDS = np.array([0.0, 0.1, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0])
#: Columns: predicted, received, whether the place is in sight.
PREDICTED, RECEIVED, SIGHT = range(3)


def main(
    plans: Positional[tuple[str, ...]] = ("office",),
    *,
    decisions: int = 400,
    options: OmitArgPrefixes[Options] = DEFAULT,
) -> Results:
    """Silence: how often places are received, by the probability predicted; regions drawn on the last map.

    Goes on after a kill if it is given the same folder.

    Args:
        plans: Floor plans, or folders of them.
        decisions: Decisions of each robot.
        options: Of every benchmark.
    """
    units = {plan.name: (plan, decisions, options.seed) for plan in plans_of(plans)}
    explored = run_units(explore, units, options.folder("silence"), workers=options.workers)
    results = Results()
    rows = [row["judged"] for row in explored.values()]
    summarise(rows, results)
    results.figures["silence"] = draw(rows)
    for name, row in explored.items():
        results.figures[f"regions-{name}"] = draw_regions(*row["last"])
    return options.finish("silence", results)


def explore(plan: FloorPlan, decisions: int, seed: int) -> dict[str, Any]:
    """Explore a building; what was predicted and received of places, and the building with the last map."""
    building = make_building(plan)
    simulator = SimulatorConfig(physics="kinematic")
    places = reach(building, *simulator.robot.hull_m)
    seed = zlib.crc32(f"{seed} {plan.name}".encode())
    rng = np.random.default_rng([seed, 1])
    task = make_task(places, np.random.default_rng([seed, 0]))
    link = RadioLink(building, simulator.radio)
    judged: list[tuple[float, float, float]] = []

    def ask(log: EpisodeLog, step: Step) -> None:
        if step.number % EVERY == 0 and step.number:
            true, estimate = step.true.pose, step.estimated.map
            targets = [make_task(places, rng).target for _ in range(PLACES)]
            judged.extend(answers(estimate, true, np.array(targets), link, rng))

    config = EpisodeConfig(goal="explore", seed=seed, max_steps=decisions, simulator=simulator)
    _, estimate = run_episode(building, places, task, config, ask)
    return {"judged": np.array(judged).reshape(-1, 3), "last": (building, estimate)}


def answers(
    estimate: MapEstimate,
    true: Float[np.ndarray, "3"],
    targets: Float[np.ndarray, "n 2"],
    link: RadioLink,
    rng: np.random.Generator,
) -> list[tuple[float, float, float]]:
    """Predicted and true reception at a true pose of targets around it, and whether each is in sight."""
    survey, here = survey_around(estimate), estimate.pose[:2]
    routes = survey.routes(here)
    x, y = survey.frame.axes()
    distance_m = np.hypot(x[None] - here[0], y[:, None] - here[1])
    received = np.full(survey.frame.shape, np.nan)
    predicted = routes.received(distance_m[routes.rows, routes.columns])
    # Of places without a route on the map nothing is predicted.
    received[routes.rows, routes.columns] = np.where(np.isfinite(routes.length_m), predicted, np.nan)
    is_seen = in_sight(survey.known, here, survey.frame, FAR_M, through_unknown=False)
    rows = []
    for target in targets:
        cell = tuple(int(i) for i in survey.frame.index(target))
        if np.hypot(*(target - true[:2])) < FAR_M and np.isfinite(received[cell]):
            link.place(target)
            count = int(link.measure(true, rng).count[0])
            rows.append((float(received[cell]), float(count > 0), float(is_seen[cell])))
    return rows


def survey_around(estimate: MapEstimate) -> MapSurvey:
    """The map over cells of a belief around the robot."""
    half = int(1.5 * FAR_M / CELL_M)
    corner = estimate.pose[:2] - half * CELL_M
    frame = GridFrame(
        origin_xy=(float(corner[0]), float(corner[1])), resolution_m=CELL_M, shape=(2 * half, 2 * half)
    )
    return MapSurvey(estimate, frame)


def summarise(rows: list[Float[np.ndarray, "n 3"]], results: Results) -> None:
    """Add the share of received places, by what was predicted."""
    every = np.concatenate(rows)
    seen = every[every[:, SIGHT] > 0]
    share = seen[:, RECEIVED].mean() if len(seen) else None
    results.add("reception", "in sight", "received", share, digits=3, cases=len(seen))
    for low, high in pairwise(BOUNDS):
        label = f"{low:g} to {high:g}"
        value, spread, predicted, count = reliability(rows, low, high)
        results.add("reception", label, "predicted", predicted, digits=2, cases=count)
        results.add("reception", label, "received", value, digits=2, spread=spread, cases=count)
    hidden = every[every[:, SIGHT] == 0]
    p, hit = np.clip(hidden[:, PREDICTED], 0.01, 0.99), hidden[:, RECEIVED]
    for name, claim in (("predicted", p), ("a constant", np.full(len(p), hit.mean()))):
        loss = -(hit * np.log(claim) + (1 - hit) * np.log(1 - claim)).mean()
        results.add("log loss", name, "out of sight", loss, digits=3, cases=len(hidden))


def reliability(
    rows: list[Float[np.ndarray, "n 3"]], low: float, high: float
) -> tuple[float, tuple[float, float] | None, float, int]:
    """Share received with its interval, mean prediction, and number of the places of a class out of sight."""
    sums = []
    for row in rows:
        inside = row[(row[:, SIGHT] == 0) & (row[:, PREDICTED] >= low) & (row[:, PREDICTED] < high + 1e-9)]
        sums.append((inside[:, RECEIVED].sum(), inside[:, PREDICTED].sum(), len(inside)))
    hits, predicted, counts = np.array(sums).T
    share, spread = ratio_interval(hits, counts)
    return share, spread, predicted.sum() / max(counts.sum(), 1), int(counts.sum())


def draw(rows: list[Float[np.ndarray, "n 3"]]) -> Figure:
    """Reliability: received over predicted."""
    figure, (axes,) = figure_of(1)
    for low, high in pairwise(BOUNDS):
        value, spread, predicted, _ = reliability(rows, low, high)
        ends = spread or (value, value)
        error = [[value - ends[0]], [ends[1] - value]]
        axes.errorbar(predicted, value, error, marker="o", ms=4, capsize=3, color="tab:blue")
    axes.plot([0, 1], [0, 1], color="0.7", lw=1)
    axes.set(xlabel="predicted probability of reception", ylabel="share received", xlim=(0, 1), ylim=(0, 1))
    return figure


def draw_regions(building: Building, estimate: MapEstimate) -> Figure:
    """Regions behind the frontiers of a map, each in a colour, and the frontiers."""
    survey = survey_around(estimate)
    box = cut_box(estimate, *known_box(estimate))
    times = travel_time_from_robot(box, CostConfig(), SimulatorConfig().robot.hull)
    frontiers = find_frontiers(box, times, min_cells=3, piece_m=1.6, given_up=np.zeros((0, 2)))
    figure, axes = plan_axes(building)
    estimate.plot(axes)
    building.draw_walls(axes)
    if frontiers:
        cells = cells_of_regions(frontiers, survey, estimate.pose[:2])
        x, y = survey.frame.axes()
        region = np.ma.masked_less(cells.region, 0)
        axes.pcolormesh(
            x[cells.columns], y[cells.rows], region % 20, cmap="tab20", alpha=0.6, vmin=0, vmax=19
        )
        goals = np.array([frontier.goal_xy for frontier in frontiers])
        axes.plot(*goals.T, "k.", ms=6, label="frontier")
    regions = Patch(facecolor="tab:purple", alpha=0.6, label="region of a frontier, each in a colour")
    explain(axes, [*wall_keys(furnished=False), *map_keys(), regions])
    return figure
