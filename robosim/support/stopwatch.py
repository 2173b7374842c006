"""Where the time goes: seconds by stage of a loop."""

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

#: The stages that make up one decision of an episode; building scenes and drawing videos come on top.
LOOP_STAGES = (
    "physics", "camera", "noise", "lidar", "radio", "recognition", "mapper", "link state", "team", "goal", "planner",
    "judging",
)  # fmt: skip


class Stopwatch:
    """Adds up the time spent in named stages."""

    def __init__(self, clock: Callable[[], float] = perf_counter) -> None:
        """Start with nothing; `clock` gives the time [s], such as `time.process_time`."""
        self._clock = clock
        self.seconds: defaultdict[str, float] = defaultdict(float)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count the time of a `with` block to a stage."""
        begin = self._clock()
        try:
            yield
        finally:
            self.seconds[name] += self._clock() - begin
