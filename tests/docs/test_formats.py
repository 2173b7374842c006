"""Tables of columns in `docs/formats` equal the files that the commands write."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from robosim.cli import main

DOCS = Path(__file__).resolve().parents[2] / "docs"
WEIGHTS = DOCS.parent / "assets" / "weights"


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with small results of each command."""
    out = tmp_path_factory.mktemp("written")
    suite = out / "suite.yaml"
    suite.write_text(
        "plans: {flat: flat}\ntasks: [{plan: flat, start: [6, 6.4, 30], target: [6.8, 6.9]}]\n", "utf-8"
    )
    quick = "--mapper classical --physics kinematic --building.tolerance-m 0.05 --radio.estimator pca"
    lines = (
        f"episode flat --start 6,6.4,30 --target 6.8,6.9 --goal los --max-steps 5 {quick} --no-video"
        f" --out {out}/episode",
        f"evaluate {suite} --policies los --max-steps 5 {quick} --workers 1 --out {out}/evaluation",
        f"trace flat --tx 7,7 --grid 2 --tolerance 0.1 --no-plots --workers 1 --out {out}/trace",
        f"dataset flat --tx-per-plan 1 --grid 2 --estimator pca --format mmwrobotnav --workers 1 --out {out}/dataset",
        f"collect --homes 1 --steps 2 --workers 1 --out {out}/collect",
    )
    for line in lines:
        main(line.split())
    return out


def documented(name: str) -> dict[str, list[str]]:
    """Names in the table of a file with the rest of their rows; lists and ranges of names are expanded."""
    rows: dict[str, list[str]] = {}
    pages = [page.read_text("utf-8") for page in sorted((DOCS / "formats").glob("*.md"))]
    (page,) = [page for page in pages if f"<!-- columns: {name} -->" in page]
    table = page.split(f"<!-- columns: {name} -->")[1].strip().split("\n\n")[0]
    for line in table.splitlines()[2:]:
        cells = [cell.strip().replace(r"\|", "|") for cell in line.strip("|").split("|")]
        first = cells[0]
        if ends := re.fullmatch(r"`(\D*|)(\d+)(\D*)` to `\1(\d+)\3`", first):
            names = [f"{ends[1]}{k}{ends[3]}" for k in range(int(ends[2]), int(ends[4]) + 1)]
        else:
            names = re.findall(r"`([^`]+)`", first) or [""]
        rows |= {one: cells[1:] for one in names}
    return rows


@pytest.mark.parametrize(
    ("table", "file"),
    [
        ("episodes.parquet", "evaluation/episodes.parquet"),
        ("timing.parquet", "evaluation/timing.parquet"),
        ("links.parquet", "dataset/links/flat_Tx_1.parquet"),
        ("paths.parquet", "trace/paths.parquet"),
        ("coverage.parquet", "trace/coverage.parquet"),
    ],
)
def test_parquet(written: Path, table: str, file: str) -> None:
    """Names and types of columns."""
    schema = pq.read_schema(written / file)
    listed = {name: row[0] for name, row in documented(table).items()}
    # The length of fixed-size lists depends on the number of traced interactions.
    found = {field.name: re.sub(r"<element: (\w+)>(\[\d+\])?", r"<\1>", str(field.type)) for field in schema}
    assert list(listed) == list(found)
    # A column without a value in these few rows has no type.
    assert {name: kind for name, kind in listed.items() if found[name] != "null"} == {
        name: kind for name, kind in found.items() if kind != "null"
    }


def test_units_of_links() -> None:
    """Units of a data set's columns are those of their metadata."""
    from wireless.formats.link_records import COLUMNS

    assert {name: row[1] for name, row in documented("links.parquet").items()} == {
        name: unit for name, (_, unit, _) in COLUMNS.items()
    }


@pytest.mark.parametrize(
    ("table", "file"),
    [
        ("episode.npz", "episode/episode.npz"),
        ("episode.npz", "evaluation/episodes/flat/000-los-0.npz"),
        ("frames.npz", "collect/home-00000.npz"),
        ("coverage.npz", "trace/coverage.npz"),
    ],
)
def test_archives(written: Path, table: str, file: str) -> None:
    """Names, types and dimensions of arrays."""
    with np.load(written / file, allow_pickle=False) as archive:
        found = {name: (archive[name].dtype, archive[name].ndim) for name in archive.files}
    listed = documented(table)
    assert set(listed) == set(found)
    for name, (kind, shape, *_) in listed.items():
        dtype, ndim = found[name]
        assert kind == ("text" if dtype.kind == "U" else str(dtype)), name
        assert len([axis for axis in shape.strip("()").split(",") if axis.strip()]) == ndim, name


def test_deepmimo(written: Path) -> None:
    """Archives of a scenario, each with one array."""
    folder = written / "trace" / "deepmimo_scenarios" / "flat"
    found = {}
    for path in folder.glob("*_t000_tx000_r001.npz"):
        with np.load(path) as archive:
            (name,) = archive.files
            found[name] = str(archive[name].dtype), archive[name].ndim
    listed = {name: (row[0], row[1].count(",") + 1) for name, row in documented("deepmimo").items()}
    assert listed == found


@pytest.mark.parametrize(
    ("table", "file"),
    [
        ("traced.csv", "trace/flat_Tx_1.csv"),
        ("estimated.csv", "dataset/mmwrobotnav/flat/flat_Tx_1_beam_search.csv"),
    ],
)
def test_csv(written: Path, table: str, file: str) -> None:
    """Names of columns."""
    with (written / file).open(newline="") as lines:
        header = next(csv.reader(lines))
    assert sorted(documented(table)) == sorted(header)


_JSON = {
    "text": str,
    "integer": int,
    "number": (int, float),
    "bool": bool,
    "object": dict,
    "list of numbers": list,
    "null": type(None),
}


@pytest.mark.parametrize("table", ["result.json", "settings.json"])
def test_json(written: Path, table: str) -> None:
    """Keys and types."""
    value = json.loads((written / "episode" / table).read_text("utf-8"))
    listed = documented(table)
    assert set(listed) == set(value)
    for name, (kind, *_) in listed.items():
        kinds = tuple(_JSON[one] for one in kind.split(" or "))
        assert isinstance(value[name], kinds), name  # type: ignore[arg-type]


def test_cards() -> None:
    """Keys of the cards of all shipped networks."""
    for card in (path.with_suffix(".json") for path in WEIGHTS.glob("*.safetensors")):
        assert set(documented("cards")) <= set(json.loads(card.read_text("utf-8"))), card.name
