"""The published figures of radio, drawn anew from any plans: antennas, links, angles, training, maps of states.

Every plan is traced and measured as in the reference: transmitters and receivers at random places of its grid,
the base station's arrays sending to the robot's. What is drawn is chosen by rule: of links, the LOS and the
first-order one with the most strong paths from different sides; of transmitters, the one whose receivers are
most evenly in different states.
Reference: arXiv 2110.14789, whose numbers are given beside ours.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Shaped, UInt8
from matplotlib.figure import Figure
from rich.console import Console

from robosim.building.building import BuildingConfig
from robosim.building.outline import check_tolerance
from robosim.drawing.gallery import Picture, write_index
from robosim.drawing.links import choose_telling, link_figure
from robosim.drawing.radio import draw_state
from robosim.drawing.shares import draw_shares
from robosim.evaluation.arrivals import PUBLISHED, on_plan, pooled, trace_links
from robosim.figures.training import draw_training
from robosim.parts import CLASSIFIER
from robosim.plans.floorplan import FloorPlan
from robosim.radio.link_state import read_classifier
from robosim.radio.receivers import check_step, receiver_grid
from robosim.radio.scene import RadioConfig, RadioScene
from robosim.support.assets import shipped_weights
from robosim.support.checks import SEED, check_numbers
from robosim.support.figures import save_figure
from robosim.support.progress import tracked
from wireless.antennas.codebook import terminal_named
from wireless.antennas.figures import arrays_figure
from wireless.estimation.estimators import ESTIMATORS, PathEstimator, estimator_named
from wireless.paths import LinkState, Paths
from wireless.sounding.sounder import Rays, Sounder
from wireless.support.counting import counted

if TYPE_CHECKING:
    from wireless.linkstate.classifier import LinkStateClassifier

#: Links that are measured at once.
BLOCK_LINKS = 512


@dataclass(frozen=True, kw_only=True)
class FiguresConfig:
    """What is traced and told for the figures."""

    links: int = 2000
    """Links of each plan for errors of angles."""
    grid_m: float = 0.15
    """Step between receivers of the map of states [m]."""
    tolerance_m: float | None = None
    """How far walls may be moved to straighten them [m]."""
    classifier: str | None = None
    """What tells link states (`robosim.radio.link_state`); None for a shipped one that goes by what is estimated."""
    training: tuple[Path, ...] = ()
    """Folders of training runs."""
    seed: int = 0
    """Of places, phases and noise."""

    def __post_init__(self) -> None:
        check_numbers(self, links=(1, 1_000_000), seed=SEED)
        check_step(self.grid_m)
        check_tolerance(self.tolerance_m)
        if self.classifier is not None:
            CLASSIFIER.check("classifier", self.classifier)

    @property
    def radio(self) -> RadioConfig:
        """How plans are traced."""
        return RadioConfig(building=BuildingConfig(tolerance_m=self.tolerance_m))


def draw_wireless(
    plans: Sequence[FloorPlan], out: Path, config: FiguresConfig, console: Console | None = None
) -> tuple[Path, list[str]]:
    """Draw all figures of radio, and a page that shows them.

    Args:
        plans: Floor plans; links and maps are of the first.
        out: Folder for the files.
        config: What is traced and told.
        console: Where progress is shown; None for nowhere.

    Returns:
        The page, and notes on what is missing.

    Raises:
        ValueError: If a plan is too small for so many links, or a file is not what it should be.
    """
    classifier = find_classifier(config.classifier)
    pictures, notes = draw_training(config.training, out)
    rng = np.random.default_rng(config.seed)
    sounder = Sounder(terminal_named("gnb"), terminal_named("ue"))
    estimators: dict[str, PathEstimator] = {name: estimator_named(name, sounder) for name in ESTIMATORS}
    save_figure(arrays_figure(), out / "arrays.png")
    with tracked(plans, "tracing", console) as shown:
        traced = [trace_links(plan, config.links, rng, config.radio) for plan in shown]
    scene = RadioScene(plans[0], config.radio)
    links, missing = _draw_links(scene, traced[0], sounder, estimators["sage"], rng, out)
    rows = [
        row
        for plan, paths in zip(plans, traced, strict=True)
        for row in on_plan(plan.name, paths, sounder, estimators, rng)
    ]
    errors = _draw_errors(rows, len(plans), out)
    order = [ARRAYS, *links, errors, *pictures]
    if classifier is None:
        missing.append(
            f"No map of link states: {config.classifier or 'each classifier shipped'} needs heights of peaks, which "
            "are not estimated. Give one by --classifier that does without."
        )
    else:
        told = partial(
            tell_states,
            classifier=classifier,
            sounder=sounder,
            estimator=estimators["sage"],
            rng=rng,
            console=console,
        )
        order.append(_draw_states(scene, traced[0], told, config.grid_m, out))
    notes = [*missing, *notes]
    title = f"Radio in {', '.join(plan.name for plan in plans)}"
    return write_index(out, title, order, notes), notes


ARRAYS = Picture(
    name="arrays.png",
    title="Beams and coverage of the arrays",
    caption="Directivity by azimuth [dBi]: elements, and the base station's 48 beams (gnb, 3 planes of 4 x 4) and "
    "the robot's 24 (ue, 3 lines of 8), each array in its own colour; thick, the best that an array can do. "
    "Published: with three arrays the worst azimuth is about 3 dB under the best.",
)


def _draw_links(
    scene: RadioScene,
    paths: Paths,
    sounder: Sounder,
    estimator: PathEstimator,
    rng: np.random.Generator,
    out: Path,
) -> tuple[list[Picture], list[str]]:
    """Received power over directions for a link in sight and one round a corner."""
    pictures, notes = [], []
    rays = Rays.from_paths(paths)
    for state, name, words in (
        (LinkState.LOS, "los", "a link in line of sight"),
        (LinkState.FIRST_ORDER, "nlos", "a link round a corner"),
    ):
        link = choose_telling(paths, state)
        if link is None:
            notes.append(f"No picture of {words}: none was traced in {scene.building.plan.name}.")
            continue
        tensor = sounder.measure(rays[link : link + 1], rng)
        figure = link_figure(scene.building, paths, link, sounder, tensor[0], estimator.estimate(tensor))
        save_figure(figure, out / f"link-{name}.png")
        pictures.append(
            Picture(
                name=f"link-{name}.png",
                title=f"Received power over directions: {words}",
                caption="Left, all traced paths. Right, what the robot receives from each beam of the base station, "
                "by the azimuth it looks to, at the strongest delay, with both antennas' gains; true paths, the larger "
                "the stronger, and estimated ones by rank. Out of sight, energy comes from several sides.",
            )
        )
    return pictures, notes


def _draw_errors(rows: list[dict[str, Any]], n_plans: int, out: Path) -> Picture:
    """Errors of the strongest path's azimuth of arrival."""
    summary = pooled(rows)
    figure = Figure(figsize=(8, 5.6), layout="constrained")
    axes = figure.subplots()
    draw_shares(axes, summary, PUBLISHED)
    axes.set_title(f"azimuth of arrival of the strongest path, {counted(n_plans, 'plan')}", fontsize=10)
    save_figure(figure, out / "aoa-error.png")
    shares = "; ".join(
        f"{row['state'].lower().replace('_', '-')} {100 * row['within'][5.0]:.1f} %"
        for row in summary
        if row["estimator"] == "sage" and row["links"]
    )
    return Picture(
        name="aoa-error.png",
        title="Errors of the azimuth of arrival",
        caption="Share of links whose strongest estimated path is within an error of the strongest true one, by true "
        "link state: our estimator sage drawn through, the published method pca dashed, dotted the limit of a perfect "
        "receiver that cannot tell alike paths apart, squares what was published "
        f"on other buildings (60 % of higher-order links within 10 degrees is an upper bound). Of ours within 5 "
        f"degrees: {shares}. Published: LOS 98 %, first order 81 to 85 %.",
    )


def find_classifier(name: str | None) -> "LinkStateClassifier | None":
    """The classifier of a name, or one of those shipped; None if it needs more than what is estimated here.

    Args:
        name: A shipped one by name, or a file; None for any shipped, the one that uses most.
    """
    found = [read_classifier(one) for one in ([name] if name else shipped_weights())]
    fitting = [one for one in found if "peak" not in one.inputs]
    return max(fitting, key=lambda one: len(one.inputs), default=None)


def most_mixed(state: Shaped[np.ndarray, "n_tx n_rx"]) -> int:
    """Transmitter whose receivers are spread most evenly over the link states (largest entropy)."""
    share = np.stack([(state == one).mean(axis=1) for one in LinkState])
    with np.errstate(divide="ignore", invalid="ignore"):
        return int(np.argmax(-np.nansum(share * np.log(share), axis=0)))


def tell_states(
    paths: Paths,
    classifier: "LinkStateClassifier",
    sounder: Sounder,
    estimator: PathEstimator,
    rng: np.random.Generator,
    console: Console | None = None,
) -> UInt8[np.ndarray, " links"]:
    """The most probable `LinkState` of each link, as told from a measurement of it.

    Args:
        paths: True paths of links.
        classifier: What tells.
        sounder: What measures.
        estimator: What makes paths of measurements again.
        rng: Source of noise, phases and offsets.
        console: Where progress is shown; None for nowhere.
    """
    rays = Rays.from_paths(paths)
    told = np.empty(len(rays), np.uint8)
    starts = range(0, len(rays), BLOCK_LINKS)
    with tracked(starts, "telling states", console) as shown:
        for start in shown:
            links = slice(start, start + BLOCK_LINKS)
            found = estimator.estimate(sounder.measure(rays[links], rng))
            told[links] = classifier.predict(
                found.aoa_rad, found.snr_db, aod_rad=found.aod_rad, delay_s=found.delay_s
            ).argmax(axis=1)
    return told


def _draw_states(
    scene: RadioScene, paths: Paths, told: Callable[[Paths], np.ndarray], step_m: float, out: Path
) -> Picture:
    """True and told link states of the transmitter whose receivers are most mixed."""
    grid = receiver_grid(scene.building, step_m, scene.config.height_m)
    tx = paths.tx_position[[most_mixed(paths.link_state())]]
    links = scene.tracer.trace(tx, grid.position)
    true = links.link_state()[0]
    guess = told(links)
    right = np.mean(guess == true)
    figure = Figure(figsize=(13, 7), layout="constrained")
    left, middle = figure.subplots(1, 2)
    for axes, state, title in (
        (left, true, "true link state"),
        (middle, guess, f"estimated link state, {100 * right:.1f} % correct"),
    ):
        draw_state(axes, scene.building, grid, state, tx[0], title, frequency_hz=paths.frequency_hz)
    save_figure(figure, out / "states.png")
    return Picture(
        name="states.png",
        title="True and told link states",
        caption=f"Link states of {len(true):,} receivers {step_m:g} m apart, by all traced paths and as a classifier "
        f"tells them from one noisy measurement each; {100 * right:.1f} % are right.",
    )
