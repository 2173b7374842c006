"""Generated floor plans against real ones: distances of Kolmogorov and Smirnov between their statistics."""

from tyro.conf import OmitArgPrefixes, Positional

from robosim.generator.generate import GeneratorConfig, generate_plan
from robosim.support.progress import tracked
from tests.benchmarks.harness import DEFAULT, Options, console, plans_of
from tests.benchmarks.plan_statistics import TITLES, compare_plans, ks_distance, plan_statistics
from tests.benchmarks.results import Results


def main(
    plans: Positional[tuple[str, ...]], *, count: int = 200, options: OmitArgPrefixes[Options] = DEFAULT
) -> Results:
    """Generated homes against real ones: size, rooms, walls, doors, narrowest passages.

    Args:
        plans: Real floor plans, or folders of them.
        count: Number of generated plans.
        options: Of every benchmark.
    """
    real, config = plans_of(plans), GeneratorConfig(navigable=True)
    with tracked(range(options.seed, options.seed + count), "generating", console) as numbers:
        generated = [plan_statistics(generate_plan(number, config=config)) for number in numbers]
    results = Results()
    for name, (a, b) in compare_plans([plan_statistics(plan) for plan in real], generated).items():
        results.add("statistics", TITLES[name], "distance", ks_distance(a, b), digits=2, cases=len(real))
    return options.finish("plans", results)
