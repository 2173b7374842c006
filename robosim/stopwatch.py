"""Where the time goes: seconds by stage of a loop."""

from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter

#: The stages that make up one decision of an episode; building scenes and drawing videos come on top.
LOOP_STAGES = (
    "physics", "camera", "noise", "radio", "recognition", "mapper", "link state", "goal", "planner", "judging",
)  # fmt: skip


class Stopwatch:
    """Adds up the wall-clock time spent in named stages."""

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time of a `with` block to a stage."""
        begin = perf_counter()
        try:
            yield
        finally:
            self.seconds[name] += perf_counter() - begin
