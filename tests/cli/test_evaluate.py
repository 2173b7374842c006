"""`robosim evaluate`: from floor plans to a table, with any number of workers."""

import pyarrow.parquet as pq
import pytest

from robosim.cli import main

OPTIONS = (
    "--policies explore --physics kinematic --camera embree --image.height 48 --max-steps 20 --noise.level 0.5 "
    "--seeds 2"
)


def test_workers_change_nothing_and_the_suite_brings_the_same_tasks(plan_file, tmp_path, capsys):
    """One worker on a plan, two on the suite file that it wrote: the same tables, byte for byte, and printed last."""
    suite = tmp_path / "suites/pair.json"
    main(
        f"evaluate {plan_file} --targets 1 --workers 1 --suite-out {suite} {OPTIONS} --out {tmp_path}/one".split()
    )
    printed = capsys.readouterr().out
    main(f"evaluate {suite} --workers 2 {OPTIONS} --out {tmp_path}/two".split())
    assert (tmp_path / "one/episodes.parquet").read_bytes() == (
        tmp_path / "two/episodes.parquet"
    ).read_bytes()
    rows = pq.read_table(tmp_path / "one/episodes.parquet").to_pylist()
    assert [(row["policy"], row["task"], row["repeat"]) for row in rows] == [
        (policy, 0, repeat) for policy in ("oracle", "explore") for repeat in (0, 1)
    ]
    timing = pq.read_table(tmp_path / "two/timing.parquet").to_pylist()
    assert all(row["wall"] > 0 for row in timing)
    again = capsys.readouterr().out
    table = printed[printed.index("policy") :]
    assert "explore" in table
    assert again[again.index("policy") :] == table


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("evaluate flat --targets 0", "targets is 0"),
        ("evaluate flat --workers 0", "workers is 0"),
        ("evaluate flat --seeds 0", "seeds is 0"),
        ("evaluate flat --policies las", "policies is 'las'. Did you mean 'los'? Known: oracle"),
        ("evaluate {suite} --targets 3", "give it alone"),
        ("evaluate {suite} flat", "give it alone"),
        ("evaluate nowhere", "nowhere: no such file"),
    ],
)
def test_mistakes_end_in_one_sentence(command, message, tmp_path, fails):
    suite = tmp_path / "suite.yaml"
    suite.write_text("plans: {flat: flat}\ntasks: [{plan: flat, start: [7, 7, 0], target: [9, 8]}]")
    assert message in fails(*command.format(suite=suite).split(), "--out", tmp_path / "out")
