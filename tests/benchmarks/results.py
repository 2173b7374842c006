"""Results of benchmarks: what a run measured, as tables, and as the JSON file that pages take their numbers from.

A file of docs/results/data holds one object: `command`, `commit`, `date`, `processor` and `results`, a list of objects
with `table`, `row`, `name`, `value`, `unit` and, where they are known, `spread` (two ends of an interval or quartiles),
`cases` and `bar` (a value to compare with), and `digits` (decimals to show).
"""

import json
import platform
import re
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from robosim.evaluation.search_scores import bootstrap, by_plan

ROOT = Path(__file__).resolve().parents[2]
#: Where published results are.
DATA = ROOT / "docs" / "results" / "data"


@dataclass
class Results:
    """What a benchmark measured, and the figures that it draws."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)
    """Matplotlib figures by the names of their files."""
    about: dict[str, Any] = field(default_factory=dict)
    """Command, commit, date and processor."""

    def add(
        self,
        table: str,
        row: str,
        name: str,
        value: float | None,
        unit: str = "",
        *,
        digits: int | None = None,
        spread: tuple[float, float] | None = None,
        cases: int | None = None,
        bar: float | None = None,
    ) -> None:
        """Add one number.

        Args:
            table: Table that it stands in.
            row: Its row, such as a plan or a setting.
            name: Its column, such as a quantity.
            value: The number; None if there is only a range.
            unit: Its unit.
            digits: Decimals to show; three significant digits if not given.
            spread: Ends of a 95 % interval, or quartiles.
            cases: Number of cases.
            bar: Value to compare with.
        """
        numbers = {"value": _plain(value), "spread": spread and [_plain(end) for end in spread]}
        more = {"unit": unit, "digits": digits, "cases": cases and int(cases), "bar": _plain(bar)}
        known = {key: one for key, one in {**numbers, **more}.items() if one not in (None, "")}
        self.rows.append({"table": table, "row": row, "name": name, **known})

    def add_ratio(
        self,
        table: str,
        row: str,
        name: str,
        ratios: Float[np.ndarray, " n"],
        plans: Sequence[str],
        bar: float | None = None,
    ) -> None:
        """Add the geometric mean of ratios, one for each case, with an interval that draws their plans again."""
        mean, low, high = np.exp(bootstrap(by_plan(np.log(ratios)[:, None], plans), None)).tolist()
        spread = (low, high) if len(ratios) > 1 else None
        self.add(table, row, name, mean, digits=2, spread=spread, cases=len(ratios), bar=bar)

    def tables(self) -> dict[str, list[list[str]]]:
        """Cells of each table by its name, the head first."""
        return {name: self.table(name) for name in dict.fromkeys(row["table"] for row in self.rows)}

    def table(self, table: str) -> list[list[str]]:
        """Cells of one table, the head first.

        Raises:
            KeyError: If there is no such table.
        """
        own = {(row["row"], row["name"]): row for row in self.rows if row["table"] == table}
        if not own:
            raise KeyError(
                f"no table {table!r}, only {', '.join(dict.fromkeys(r['table'] for r in self.rows))}"
            )
        lines, names = dict.fromkeys(row for row, _ in own), dict.fromkeys(name for _, name in own)
        units = {name: {row.get("unit", "") for (_, n), row in own.items() if n == name} for name in names}
        one = {name: next(iter(units[name])) if len(units[name]) == 1 else "" for name in names}
        head = ["", *(f"{name} [{one[name]}]" if one[name] else name for name in names)]
        cells = [
            [text(own[line, name], unit=not one[name]) if (line, name) in own else "" for name in names]
            for line in lines
        ]
        return [head, *([line, *row] for line, row in zip(lines, cells, strict=True))]

    def find(self, table: str, row: str, name: str) -> dict[str, Any]:
        """One number.

        Raises:
            KeyError: If there is none of that table, row and name.
        """
        for one in self.rows:
            if (one["table"], one["row"], one["name"]) == (table, row, name):
                return one
        raise KeyError(f"no result {table} / {row} / {name}")

    def write(self, path: Path, command: str) -> None:
        """Write the JSON file, a result in each line.

        Args:
            path: File to write.
            command: Command that measured.
        """
        head = {
            "command": command,
            "commit": _output("git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"),
            "date": f"{date.today():%Y-%m-%d}",
            "processor": processor(),
            **self.about,
        }
        lines = ",\n".join(f"  {json.dumps(row, ensure_ascii=False, allow_nan=False)}" for row in self.rows)
        about = json.dumps(head, ensure_ascii=False, indent=1)[:-2]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f'{about},\n "results": [\n{lines}\n ]\n}}\n', encoding="utf-8")


def read_results(name: str) -> Results:
    """Published results of a benchmark.

    Args:
        name: Of the file in docs/results/data, without its ending.
    """
    about = json.loads((DATA / f"{name}.json").read_text(encoding="utf-8"))
    return Results(rows=about.pop("results"), about=about)


def text(result: dict[str, Any], *, unit: bool = True) -> str:
    """A result as readers see it: 93.8 %, 0.97 (0.84 to 1.07), 6,800 to 11,900."""
    value, spread = result.get("value"), result.get("spread")
    numbers = [
        _number(one, result.get("digits")) for one in ([] if value is None else [value]) + (spread or [])
    ]
    ends = " to ".join(numbers[-2:]) if spread else ""
    shown = ends if value is None else f"{numbers[0]} ({ends})" if spread else numbers[0]
    after = result.get("unit", "") if unit else ""
    return f"{shown}{'' if after in ('', '°') else ' '}{after}" if shown else "-"


def resolved(template: str) -> str:
    """A text whose {file/table/row/name} are replaced by published results, {.../bar} by what they are compared with.

    Raises:
        KeyError: If there is no such result.
    """

    def found(match: re.Match[str]) -> str:
        name, *place = match[1].split("/")
        result = read_results(name).find(*place[:3])
        if place[3:]:
            result = {"value": result["bar"], "unit": result.get("unit", ""), "digits": result.get("digits")}
        return text(result)

    return re.sub(r"\{([^{}/]+/[^{}/]+/[^{}/]+/[^{}/]+(?:/bar)?)\}", found, template)


def markdown(cells: list[list[str]]) -> Iterator[str]:
    """Lines of a table, numbers to the right."""
    head, *rows = cells
    yield f"| {' | '.join(head)} |"
    yield f"|{'|'.join(['---', *['---:'] * (len(head) - 1)])}|"
    for row in rows:
        yield f"| {' | '.join(row)} |"


def processor() -> str:
    """Model of this machine's processor, and how many cores there are."""
    model = re.search(r"model name\s*: (.*)", _read(Path("/proc/cpuinfo")))
    cores = re.findall(r"^processor", _read(Path("/proc/cpuinfo")), re.MULTILINE)
    return f"{model[1] if model else platform.machine()}, {len(cores) or 1} cores"


def _read(path: Path) -> str:
    return path.read_text() if path.exists() else ""


def _output(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.strip() or "unknown"


def _plain(value: Any) -> float | None:
    """A number as JSON has it, to six significant digits; None for NaN and infinities."""
    if value is None or not abs(float(value)) < float("inf"):
        return None
    number = float(f"{float(value):.6g}")
    return int(number) if number == int(number) else number


def _number(value: float | None, digits: int | None) -> str:
    if value is None:  # the end of an interval, such as of a time that some searches never reach
        return "∞"
    if digits is not None:
        return f"{value:,.{digits}f}"
    return f"{value:,.0f}" if value == int(value) or abs(value) >= 100 else f"{value:.3g}"
