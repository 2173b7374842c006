"""The README's table of numbers, with values from docs/results/data."""

from pathlib import Path

from tests.benchmarks.results import ROOT, resolved

BEGIN, END = "<!-- numbers: python -m tests.benchmarks readme -->", "<!-- end of numbers -->"
#: What is measured, its numbers by {file/table/row/name}, and the page with more.
ROWS: tuple[tuple[str, str, str], ...] = (
    (
        "find a transmitter in an unknown home",
        "{search/arrived/learned/all} of 200 tasks in 20 scanned homes that nothing was trained on, in "
        "{search/over shortest/learned/all} times the steps of `shortest`, which knows the building, in the median",
        "[search](docs/results/search.md)",
    ),
    (
        "the same without a trained search (`fused`)",
        "{search/arrived/fused/all}, in {search/over shortest/fused/all} times the steps",
        "[search](docs/results/search.md)",
    ),
    (
        "the same, published by Yin et al. (2022)",
        "{search/arrived/published, los-or-first/easy} / {search/arrived/published, los-or-first/moderate} / "
        "{search/arrived/published, los-or-first/hard}, in {search/median/published, los-or-first/easy} / "
        "{search/median/published, los-or-first/moderate} / {search/median/published, los-or-first/hard} times "
        "the steps of an oracle that does not know the building (easy / moderate / hard), other tasks",
        "[published](docs/concepts/published.md)",
    ),
    (
        "trace radio links, 3 reflections and diffraction",
        "{tracing/outlines/flat, straight walls/links a CPU second} (flat) and "
        "{tracing/outlines/office, straight walls/links a CPU second} (office) per second and core",
        "[speed](docs/results/speed.md)",
    ),
    (
        "agree with published link states",
        "{labels/rules/each building by the rule of the other half/other half} of 483,690 links, in buildings that the "
        "rules are not chosen on",
        "[radio](docs/results/radio.md)",
    ),
    (
        "classify link states from estimated paths",
        "{link_states/trained/public/right} in buildings not used for training; from measurements of this simulator "
        "{link_states/shipped/all inputs/alone}",
        "[radio](docs/results/radio.md)",
    ),
    (
        "angle of arrival of the strongest path within 5°",
        "{estimation/arrivals/strongest path, sage: within 5°/line of sight} in line of sight, "
        "{estimation/arrivals/strongest path, sage: within 5°/first order} in first order",
        "[radio](docs/results/radio.md)",
    ),
    (
        "explore scanned homes that nothing was trained on",
        "{exploration_learned_map/driving/learned/seen after 250} / "
        "{exploration_learned_map/driving/learned/seen after 500} / "
        "{exploration_learned_map/driving/learned/seen after 1000} of the floor after 250 / 500 / 1000 steps",
        "[mapping](docs/results/mapping.md)",
    ),
    (
        "final pose error of a search",
        "median {search/pose at the end/learned/median}, 95 % below {search/pose at the end/learned/95 %}",
        "[search](docs/results/search.md)",
    ),
    (
        "draw an RGB-D frame of 128 x 128",
        "{render/cameras/robosim, 128 x 128/processor time of a frame} on one core",
        "[speed](docs/results/speed.md)",
    ),
)


def main(*, path: Path = ROOT / "README.md") -> None:
    """Write the README's table of numbers from docs/results/data.

    Args:
        path: The README.
    """
    path.write_text(with_numbers(path.read_text(encoding="utf-8")), encoding="utf-8")


def with_numbers(page: str) -> str:
    """A page with the table between its two marks made again.

    Raises:
        ValueError: If the page has no marks.
    """
    before, marked, rest = page.partition(BEGIN)
    _, ended, after = rest.partition(END)
    if not marked or not ended:
        raise ValueError(f"README has no {BEGIN} or no {END}.")
    lines = [f"| {what} | {resolved(numbers)} | {more} |" for what, numbers, more in ROWS]
    return "\n".join(
        [before + BEGIN, "", "| capability | measured | details |", "|---|---|---|", *lines, "", END + after]
    )
