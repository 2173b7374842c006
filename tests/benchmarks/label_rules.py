"""Rules of published link states, chosen on half of the buildings and reported on the other half.

A rule says which traced paths the published ray tracer could find: reflections of a path without an edge, reflections
next to an edge, passed walls, and whether receivers between those with rays of their own adopt paths. The candidates
are all combinations. Buildings are split in two halves by their alphabetical order, every second one in a half.
Intervals are by bootstrap over buildings.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from jaxtyping import Float, Int

from robosim.training.label_links import TRACER, adopted, with_coarse
from tests.benchmarks.harness import ratio_interval
from tests.benchmarks.results import Results
from wireless.formats.mmwrobotnav_measurements import link_states
from wireless.paths import Interaction, Paths
from wireless.tracing.tracer import Tracer


@dataclass(frozen=True)
class Rule:
    """Largest numbers of interactions of a path that the published ray tracer could find."""

    reflections: int
    """Of paths without an edge."""
    with_edge: int
    """Reflections of paths with an edge."""
    walls: int
    """Passed walls."""
    adopts: bool
    """Whether receivers without rays of their own have only paths that were found around them."""

    @property
    def words(self) -> str:
        """The rule as a table shows it."""
        counts = f"{self.reflections} reflections, {self.with_edge} next to an edge, {self.walls} walls"
        return counts + (", adopted paths" if self.adopts else ", all receivers with rays")


#: The rule of `robosim.training.label_links`, and all candidates.
DEFAULT_RULE = Rule(TRACER.max_reflections, TRACER.diffraction_reflections, TRACER.max_transmissions, True)
RULES = tuple(Rule(*each) for each in product((1, 2, 3), (0, 1, 2), (0, 1), (False, True)))


def paths_by_rule(
    tx: Float[np.ndarray, "3"], rx: Float[np.ndarray, "n 3"], cell: Int[np.ndarray, "n 2"], tracer: Tracer
) -> tuple[Paths, Int[np.ndarray, "n_rules n"]]:
    """Paths of the default rule, and the link state of each receiver by each of `RULES`, from one trace.

    Args:
        tx: Transmitter [m].
        rx: Receivers at one height [m].
        cell: Their rows and columns, from 1 at the north-west.
        tracer: Traces with `TRACER`.

    Raises:
        ValueError: If receivers are on no regular grid.
    """
    cells, position = with_coarse(cell, rx[:, :2])
    height = np.full(len(position), rx[0, 2])
    paths = tracer.trace(tx[None], np.column_stack([position, height]), workers=1)
    is_adopted, is_asked = adopted(paths, cells), paths.rx < len(rx)
    reflections, edges, walls = (
        (paths.interaction == kind).sum(axis=1)
        for kind in (Interaction.REFLECTION, Interaction.DIFFRACTION, Interaction.TRANSMISSION)
    )

    def select(rule: Rule) -> Paths:
        most = np.where(edges > 0, rule.with_edge, rule.reflections)
        which = is_asked & (reflections <= most) & (walls <= rule.walls) & (is_adopted | (not rule.adopts))
        return replace(paths.select(which), rx_position=rx)

    return select(DEFAULT_RULE), np.array([link_states(select(rule))[0] for rule in RULES])


def add_halves(
    results: Results, same: Mapping[str, Int[np.ndarray, " n_rules"]], links: Mapping[str, int]
) -> None:
    """Add agreement of the rule that is best in one half of the buildings, in the other half, and both together.

    Args:
        results: Takes the table `rules`.
        same: Links that agree by each rule, by building.
        links: Links of each building.
    """
    count, total = (np.array([each[name] for name in sorted(same)]) for each in (same, links))
    half = np.arange(len(total)) % 2
    held = np.zeros(len(total))
    for name, fitted in (("first half", half == 0), ("second half", half == 1)):
        if not fitted.any() or fitted.all():
            return
        best = int(count[fitted].sum(axis=0).argmax())
        held[~fitted] = count[~fitted, best]
        row = f"chosen on the {name}: {RULES[best].words}"
        _add(results, row, "where it is chosen", count[fitted, best], total[fitted])
        _add(results, row, "other half", count[~fitted, best], total[~fitted])
    _add(results, "each building by the rule of the other half", "other half", held, total)
    for rule in (DEFAULT_RULE, *_one_changed(DEFAULT_RULE)):
        _add(
            results, f"all buildings: {rule.words}", "where it is chosen", count[:, RULES.index(rule)], total
        )


def _one_changed(rule: Rule) -> list[Rule]:
    """Candidates that differ from a rule in a single number, by one."""

    def steps(other: Rule) -> int:
        numbers = ((r.reflections, r.with_edge, r.walls, int(r.adopts)) for r in (rule, other))
        return int(np.abs(np.subtract(*numbers)).sum())

    return [other for other in RULES if steps(other) == 1]


def _add(
    results: Results, row: str, name: str, count: Float[np.ndarray, " n"], total: Int[np.ndarray, " n"]
) -> None:
    value, spread = ratio_interval(count, total)
    ends = spread and (100 * spread[0], 100 * spread[1])
    results.add("rules", row, name, 100 * value, "%", digits=1, spread=ends, cases=int(total.sum()))
