"""The fuzzer: damaged files for every reader, in processes of their own, counted by reader and by what came of them.

    python -m tests.fuzz.run                        25,000 cases
    python -m tests.fuzz.run --only "mesh:123"      one of them again, with what was said

A failure is stored with its damaged files and what was said in --out/failures; the exit status is 1 if there is one.
"""

import argparse
import json
import math
import selectors
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from queue import Empty, Queue

from tests.fuzz.seeds import make_seeds
from tests.fuzz.targets import TARGETS
from tests.fuzz.worker import BAD, Case, Outcome

#: Seconds after which a process that has not answered is ended: a case may take 20 of the processor.
HUNG_S, READY_S = 120.0, 600.0


@dataclass
class Tally:
    """What came of the cases so far."""

    counts: dict[str, Counter[str]] = field(default_factory=dict)
    failures: list[tuple[Case, Outcome]] = field(default_factory=list)
    slowest: tuple[float, str] = (0.0, "")
    largest: tuple[float, str] = (0.0, "")

    def add(self, case: Case, outcome: Outcome) -> None:
        """Count a case."""
        name = f"{case.target}:{case.number} ({outcome.method} {outcome.file})"
        self.counts.setdefault(case.target, Counter())[outcome.kind] += 1
        self.slowest = max(self.slowest, (outcome.seconds, name))
        self.largest = max(self.largest, (outcome.peak_mb, name))
        if outcome.kind in BAD:
            self.failures.append((case, outcome))

    def lines(self) -> Iterator[str]:
        """A table: a line a target, a column a kind of outcome."""
        kinds = ["read", "rejected", *(kind for kind in BAD if any(kind in c for c in self.counts.values()))]
        yield f"{'':36}" + "".join(f"{kind:>10}" for kind in kinds)
        total: Counter[str] = Counter()
        for target in sorted(self.counts, key=list(TARGETS).index):
            total += self.counts[target]
            yield f"{target:36}" + "".join(f"{self.counts[target][kind]:10}" for kind in kinds)
        yield f"{'all':36}" + "".join(f"{total[kind]:10}" for kind in kinds)
        yield f"slowest {self.slowest[0]:.1f} s: {self.slowest[1]}"
        yield f"largest {self.largest[0]:.0f} MB more than before: {self.largest[1]}"


def cases_of(count: int, seed: int, targets: Sequence[str], seeds: Path) -> list[Case]:
    """So many cases at least, spread over the targets by their weights; one of each at least."""
    there = [name for name in targets if (seeds / TARGETS[name].seed).is_dir()]
    total = sum(TARGETS[name].weight for name in there)
    numbers = {name: math.ceil(count * TARGETS[name].weight / total) for name in there}
    return [Case(name, number, seed) for name in there for number in range(numbers[name])]


def fuzz(cases: Sequence[Case], seeds: Path, out: Path, workers: int) -> Tally:
    """Run cases, and keep the failures in a folder."""
    tally, lock, queue = Tally(), threading.Lock(), Queue[Case]()
    for case in cases:
        queue.put(case)

    def work(folder: Path) -> None:
        worker = _Worker(seeds, folder, sorted({case.target for case in cases}))
        try:
            while True:
                try:
                    case = queue.get_nowait()
                except Empty:
                    return
                outcome = worker.run(case)
                with lock:
                    tally.add(case, outcome)
                if outcome.kind in BAD:
                    _keep(case, outcome, folder / "case", out)
        finally:
            worker.close()

    with tempfile.TemporaryDirectory() as folder:
        threads = [threading.Thread(target=work, args=(Path(folder) / f"{i}",)) for i in range(workers)]
        for thread in threads:
            thread.start()
        begin = time.monotonic()
        while any(thread.is_alive() for thread in threads):
            threads[0].join(5)
            if sys.stdout.isatty() or int(time.monotonic() - begin) % 60 < 5:
                print(
                    f"{len(cases) - queue.qsize()} of {len(cases)}, {len(tally.failures)} failures",
                    flush=True,
                )
        for thread in threads:
            thread.join()
    return tally


class _Worker:
    """A process that runs cases; another one after a death."""

    def __init__(self, seeds: Path, work: Path, targets: list[str]) -> None:
        self._words = [str(seeds), str(work), *targets]
        work.mkdir(parents=True, exist_ok=True)
        self._start()

    def _start(self) -> None:
        command = [sys.executable, "-m", "tests.fuzz.worker", *self._words]
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 - as long as the process
        root = Path(__file__).resolve().parents[2]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._said, cwd=root
        )
        if self._answer(READY_S) != b"ready\n":
            raise RuntimeError(f"no process to fuzz in: {self._last_words()}")

    def run(self, case: Case) -> Outcome:
        """What comes of a case."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(asdict(case)).encode() + b"\n")
            self._process.stdin.flush()
            answer = self._answer(HUNG_S)
        except BrokenPipeError:
            answer = b""
        if answer:
            return Outcome(**json.loads(answer))
        kind = "hung" if self._process.poll() is None else "died"
        self.stop()
        words = f"exit status {self._process.returncode}: {self._last_words()}"
        self._said.close()
        self._start()
        return Outcome(kind, "?", "?", HUNG_S if kind == "hung" else 0.0, 0.0, words)

    def stop(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()

    def close(self) -> None:
        """End it permanently."""
        self.stop()
        self._said.close()

    def _answer(self, seconds: float) -> bytes:
        """The next line, or nothing if none comes in time."""
        assert self._process.stdout is not None
        with selectors.DefaultSelector() as selector:
            selector.register(self._process.stdout, selectors.EVENT_READ)
            return self._process.stdout.readline() if selector.select(seconds) else b""

    def _last_words(self) -> str:
        self._said.seek(0)
        return self._said.read().decode("utf-8", "replace")[-3000:]


def _keep(case: Case, outcome: Outcome, damaged: Path, out: Path) -> None:
    folder = out / "failures" / f"{case.target}-{case.number}".replace(" ", "-")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    with_links = shutil.ignore_patterns("pipe*")
    try:
        shutil.copytree(damaged, folder / "case", symlinks=True, ignore=with_links)
    except (shutil.Error, OSError) as error:
        (folder / "not-copied.txt").write_text(str(error))
    text = "\n".join(f"{key}: {value}" for key, value in {**asdict(case), **asdict(outcome)}.items())
    (folder / "outcome.txt").write_text(text + "\n")


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=25_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--targets", nargs="*", default=list(TARGETS), help="some of them, by name")
    parser.add_argument("--only", help="one case: TARGET:NUMBER")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        seeds = Path(folder)
        for missing in make_seeds(seeds):
            print(missing)
        cases = cases_of(options.cases, options.seed, options.targets, seeds)
        if options.only:
            target, number = options.only.rsplit(":", 1)
            cases = [Case(target, int(number), options.seed)]
        tally = fuzz(cases, seeds, options.out, options.workers)
    for case, outcome in tally.failures:
        last = outcome.message.strip().splitlines()[-1:] or [""]
        print(
            f"{case.target}:{case.number} {outcome.kind} ({outcome.method} {outcome.file}): {last[0][:300]}"
        )
    print(*tally.lines(), sep="\n")
    if tally.failures:
        print(f"The damaged files are in {options.out / 'failures'}")
        sys.exit(1)


if __name__ == "__main__":
    main()
