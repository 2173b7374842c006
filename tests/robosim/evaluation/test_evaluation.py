"""Evaluation: tasks, episodes, scores and report."""

import base64
import io
import json
import math
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pyarrow.parquet as pq
import pytest
import scipy.stats
from PIL import Image
from rich.console import Console

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.episode_config import EpisodeConfig
from robosim.episode_log import EpisodeLog
from robosim.evaluation import episodes
from robosim.evaluation.episodes import name_of
from robosim.evaluation.evaluate import code_digest, evaluate, settings_of
from robosim.evaluation.report import replay_command, summary_rows, write_parquet, write_results
from robosim.evaluation.search_scores import bootstrap, by_plan, difficulty, score, summarise, wilson
from robosim.evaluation.suite import Suite, SuiteTask, draw_tasks, name_plans, read_suite, write_suite
from robosim.plans.files import write_ros
from robosim.simulator import SimulatorConfig
from robosim.support.run_folder import FolderError
from robosim.team.team_config import TeamConfig
from tests.plans import two_rooms

pytestmark = pytest.mark.usefixtures("in_process")
QUIET = Console(quiet=True)
CONFIG = EpisodeConfig(mapper="classical", simulator=SimulatorConfig(physics="kinematic"), max_steps=25)


@pytest.fixture(scope="module")
def places():
    return reach(make_building(two_rooms(0.8)), 0.1)


@pytest.fixture
def suite(tmp_path) -> Suite:
    """One task that the oracle does within 25 steps, and one that no policy does."""
    file = tmp_path / "plans" / "pair.yaml"
    write_ros(two_rooms(0.8), file)
    tasks = (
        SuiteTask(plan="pair", number=0, start=(2.0, 1.5, 0.0), target=(4.0, 1.5)),
        SuiteTask(plan="pair", number=1, start=(0.5, 0.5, 180.0), target=(5.7, 2.7)),
    )
    return Suite(plans={"pair": file}, tasks=tasks)


def _evaluate(suite, out, **kwargs):
    return evaluate(
        suite, out, **{"config": CONFIG, "policies": ["explore"], "repeats": 1, "workers": 1, "console": QUIET} | kwargs
    )  # fmt: skip


# ---- tasks


def test_a_task_depends_on_its_seed_plan_and_number_alone(places):
    """Two tasks are the first two of four; another plan's name or seed gives others."""
    four = draw_tasks("a", places, 4, seed=3)
    assert draw_tasks("a", places, 2, seed=3) == four[:2]
    assert len({task.start for task in four}) == 4
    assert draw_tasks("b", places, 1, seed=3)[0].start != four[0].start
    assert draw_tasks("a", places, 1, seed=4)[0].start != four[0].start


def test_noise_differs_between_tasks_and_repetitions(places):
    tasks = draw_tasks("a", places, 4, seed=3)
    assert len({task.seed(3, repeat) for task in tasks for repeat in range(3)}) == 12


@pytest.mark.parametrize("name", ["suite.yaml", "suite.json"])
def test_a_suite_that_was_written_reads_the_same(suite, tmp_path, name):
    """Also from a folder of its own: plans lie relative to the file."""
    path = tmp_path / "other" / name
    write_suite(suite, path)
    assert read_suite(path) == suite
    assert str(tmp_path) not in path.read_text()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("tasks: []\nplans: {flat: flat}", "the list of tasks is empty"),
        ("tasks: 3\nplans: {flat: flat}", "tasks is 3, expected a list"),
        ("tasks: [{plan: flat}]", "the key 'plans' is missing"),
        (
            "plans: {flat: flat}\ntasks: [{plan: flt, start: [1, 2, 3], target: [4, 5]}]",
            r"plan of tasks\[0\] is 'flt'. Did you mean",
        ),
        (
            "plans: {flat: flat}\ntasks: [{plan: flat, start: [1, 2], target: [4, 5]}]",
            r"tasks\[0\].start is \[1, 2\]",
        ),
        (
            "plans: {flat: flat}\ntasks: [{plan: flat, start: [1, 2, 3], target: 4}]",
            r"tasks\[0\].target is 4",
        ),
        (
            "plans: {a/b: flat}\ntasks: [{plan: a/b, start: [1, 2, 3], target: [4, 5]}]",
            "plan a/b names files",
        ),
        ("seed: -1\nplans: {flat: flat}\ntasks: []", "seed is -1"),
        ("tasks: [", "not readable as a suite of searches"),
    ],
)
def test_mistakes_in_a_suite_are_named(tmp_path, content, message):
    path = tmp_path / "suite.yaml"
    path.write_text(content)
    with pytest.raises(ValueError, match=message):
        read_suite(path)


def test_two_plans_of_one_name_are_errors(tmp_path):
    with pytest.raises(ValueError, match="are both called 'house'"):
        name_plans([tmp_path / "a" / "house.yaml", tmp_path / "b" / "house.png"])


def test_the_replay_command_gives_the_episode_its_very_numbers(suite):
    """Start, target and seed survive printing, so that the replay is the same bit by bit."""
    job = episodes.make_jobs(suite, CONFIG, ("explore",), 1, "")[1]
    job = replace(job, task=replace(job.task, start=(0.1 + 0.2, -1 / 3, 77.07)))
    words = replay_command(job, "--noise.level 0").split()
    assert tuple(map(float, words[words.index("--start") + 1].split(","))) == job.task.start
    assert int(words[words.index("--seed") + 1]) == job.config.seed
    assert words[words.index("--goal") + 1] == "explore"
    assert words[-2:] == ["--noise.level", "0"]


# ---- scores


def _row(task, policy, at, spl=0.5, repeat=0):
    return {"plan": "p", "task": task, "policy": policy, "repeat": repeat,
            "arrived": at is not None, "arrived_at_step": at, "spl": spl if at is not None else 0.0}  # fmt: skip


@pytest.mark.parametrize(("n", "shares"), [(193, (52, 76, 65)), (200, (54, 79, 67)), (1, (0, 1, 0))])
def test_classes_have_the_published_shares(n, shares):
    """Sorted by steps, whatever order they come in; 193 tasks split exactly as published."""
    steps = {("p", (7 * i) % n): float((7 * i) % n) for i in range(n)}
    classes = difficulty(steps)
    assert tuple(sum(c == name for c in classes.values()) for name in ("easy", "moderate", "hard")) == shares
    order = [classes["p", i] for i in range(n)]
    assert order == sorted(order, key=["easy", "moderate", "hard"].index)


def test_a_task_that_the_oracle_fails_is_hard_and_has_no_relative_time():
    rows = [_row(i, "oracle", at) for i, at in enumerate([10, 20, None])]
    scored = score([*rows, _row(2, "visual", 50), _row(1, "visual", 50), _row(0, "visual", None)])
    assert [row["difficulty"] for row in scored[:3]] == ["easy", "moderate", "hard"]
    assert np.isnan(scored[3]["relative_time"])
    assert [row["relative_time"] for row in scored[4:]] == [2.5, np.inf]
    assert set(difficulty({("p", i): math.inf for i in range(4)}).values()) == {"hard"}


def test_oracle_steps_are_the_median_of_repetitions():
    """10, 30 and never: 30. A mean would be infinite."""
    rows = [_row(0, "oracle", at, repeat=i) for i, at in enumerate([10, None, 30])]
    assert score([*rows, _row(0, "los", 60)])[-1]["relative_time"] == 2.0


def test_times_are_also_given_relative_to_the_shortest_route():
    """30 steps against 20; NaN where it was not run, infinite without arrival."""
    rows = [_row(0, "oracle", 25), _row(1, "oracle", 40), _row(0, "shortest", 20)]
    scored = score([*rows, _row(0, "los", 30), _row(0, "snr", None), _row(1, "los", 50)])
    np.testing.assert_equal([row["limit_time"] for row in scored], [1.25, np.nan, 1.0, 1.5, np.inf, np.nan])
    found = {(s.policy, s.difficulty): s.limit_median.value for s in summarise(scored)}
    assert found["los", "all"] == 1.5
    assert np.isnan(summarise(score([_row(0, "oracle", 25)]))[0].limit_median.value)


def test_scoring_needs_the_oracle():
    with pytest.raises(ValueError, match="no episode of the oracle for"):
        score([_row(0, "visual", 3)])


@pytest.mark.parametrize(("k", "n"), [(0, 5), (3, 7), (65, 65), (199, 200)])
def test_intervals_of_rates_are_wilsons(k, n):
    """As SciPy's."""
    judge = scipy.stats.binomtest(k, n).proportion_ci(0.95, method="wilson")
    assert wilson(k, n) == pytest.approx((k / n, judge.low, judge.high), abs=1e-6)


def test_bootstrap_intervals_of_a_mean_are_as_wide_as_they_should_be():
    """±1.96 sigma / sqrt(n) for 400 numbers; measured within 4 %. Repetitions of a task do not narrow it."""
    x = np.random.default_rng(5).normal(3.0, 1.0, (400, 1))
    half = 1.96 * x.std() / 20
    once, thrice = bootstrap(x, None), bootstrap(np.repeat(x, 3, axis=1), None)
    for estimate in (once, thrice):
        assert estimate.value == pytest.approx(x.mean())
        assert (estimate.high - estimate.low) / 2 == pytest.approx(half, rel=0.1)


def test_a_task_alone_has_no_bootstrap_interval():
    """An interval of no width would mean that the value is certain."""
    np.testing.assert_equal(bootstrap(np.array([[1.0, 2.0, 6.0]]), None), (3.0, np.nan, np.nan))
    cells = summary_rows(summarise(score([_row(0, "oracle", 25, spl=0.5)])))[1][-1]
    assert cells[-1] == "0.500 [-, -]"


def test_the_summary_of_hand_made_episodes():
    """Ten tasks; eight arrive at 1.1 to 1.8 times the oracle's steps: median 1.5, 80 % 1.8, 90 % never."""
    rows = [_row(i, "oracle", 100 + i, spl=1.0) for i in range(10)]
    times = [1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, None, None]
    rows += [_row(i, "los", t and t * (100 + i)) for i, t in enumerate(times)]
    summaries = {(s.policy, s.difficulty): s for s in summarise(score(rows))}
    overall = summaries["los", "all"]
    assert overall.arrival_rate.value == 0.8
    assert overall.time_median.value == pytest.approx(1.5)
    assert overall.time_p80.value == pytest.approx(1.8)
    assert overall.time_p80.high == np.inf
    assert overall.spl.value == pytest.approx(0.4)
    assert [summaries["los", c].tasks for c in ("easy", "moderate", "hard")] == [3, 4, 3]
    assert summaries["los", "hard"].time_median.value == np.inf
    assert summaries["oracle", "all"].time_p80 == (1.0, 1.0, 1.0)


# ---- runs


@pytest.fixture
def tables_only(monkeypatch):
    """Leave out the pictures, which take most of the time of a small run."""

    def write(result, out, **kwargs):
        write_parquet(result.rows, out / "episodes.parquet")

    monkeypatch.setattr("robosim.evaluation.evaluate.write_results", write)


def test_a_stopped_run_goes_on_and_comes_to_the_same(suite, tmp_path, monkeypatch, tables_only):
    """Ctrl-C in the third of four episodes leaves two; going on runs two, and the table is the same, byte for byte."""
    ran, run_job = [], episodes.run_job

    def counted(job):
        if stop_at == len(ran):
            raise KeyboardInterrupt
        ran.append(job.name)
        return run_job(job)

    monkeypatch.setattr(episodes, "run_job", counted)
    stop_at = 2
    with pytest.raises(KeyboardInterrupt):
        _evaluate(suite, tmp_path / "a")
    assert len(list((tmp_path / "a").rglob("*.npz"))) == 2
    stop_at = None
    _evaluate(suite, tmp_path / "a")
    assert len(ran) == 4 == len(set(ran))
    _evaluate(suite, tmp_path / "b")
    assert len(ran) == 8
    assert (tmp_path / "a/episodes.parquet").read_bytes() == (tmp_path / "b/episodes.parquet").read_bytes()


def test_an_interrupted_episode_is_not_stored(suite, tmp_path, monkeypatch):
    """The loop returns what was done until Ctrl-C; half an episode may not count as a failure of its policy."""
    real = episodes.run_team

    def interrupted(*args):
        team = real(*args)
        team.first.ended = "interrupted"
        return team

    monkeypatch.setattr(episodes, "run_team", interrupted)
    with pytest.raises(KeyboardInterrupt):
        _evaluate(suite, tmp_path)
    assert not list(tmp_path.rglob("*.npz"))


def test_policies_can_be_added_and_other_options_are_errors(suite, tmp_path, tables_only):
    _evaluate(suite, tmp_path, policies=[])
    result = _evaluate(suite, tmp_path, policies=["explore"])
    assert [row["policy"] for row in result.rows] == ["oracle", "oracle", "explore", "explore"]
    with pytest.raises(FolderError, match=r"episode.max_steps 25 there, 30 now"):
        _evaluate(suite, tmp_path, config=replace(CONFIG, max_steps=30))
    other = replace(suite, tasks=(replace(suite.tasks[0], target=(4.5, 1.5)),))
    with pytest.raises(FolderError, match=r"tasks\.pair/0 \["):
        _evaluate(other, tmp_path)
    write_ros(two_rooms(0.7), suite.plans["pair"])
    with pytest.raises(FolderError, match=r"plans\.pair"):
        _evaluate(suite, tmp_path)


def test_other_weights_under_the_same_name_make_other_episodes(suite, tmp_path):
    """A classifier that was trained again into the same file."""
    weights = tmp_path / "states.safetensors"
    weights.write_bytes(b"first")
    config = replace(CONFIG, link_states=str(weights))
    before = settings_of(suite, config)
    assert settings_of(suite, config) == before
    weights.write_bytes(b"second")
    assert settings_of(suite, config) != before


def test_another_robot_in_the_same_file_makes_other_episodes(suite, tmp_path):
    """Settings hold the robots of a team that are named; an unknown name is rejected before anything is run."""
    file = tmp_path / "cart.yaml"
    config = replace(CONFIG, team=TeamConfig(robots=f"{file},turtlebot"))
    file.write_text("radius_m: 0.15\n")
    before = settings_of(suite, config)
    assert settings_of(suite, config) == before
    file.write_text("radius_m: 0.2\n")
    assert settings_of(suite, config) != before
    with pytest.raises(ValueError, match="robots is 'jackl'"):
        settings_of(suite, replace(CONFIG, team=TeamConfig(robots="jackl,turtlebot")))


def test_an_episode_that_fails_stops_no_other(suite, tmp_path, tables_only):
    """A target inside a wall: that task is reported with its reason, the other has its result."""
    bad = replace(suite.tasks[1], target=(3.1, 0.3))
    result = _evaluate(replace(suite, tasks=(suite.tasks[0], bad)), tmp_path)
    assert {failure.job.task.number for failure in result.errors} == {1}
    assert "is in a wall, or outside of the building" in result.errors[0].error
    assert {row["task"] for row in result.rows} == {0}
    assert "pair/001-oracle-0 failed and is left out" in result.warnings[0]


def test_a_task_outside_of_its_plan_is_an_error_before_any_other_runs(suite, tmp_path):
    """By the task's number."""
    bad = replace(suite.tasks[1], target=(50.0, 50.0))
    with pytest.raises(ValueError, match=r"task 1 of pair: target is \(50, 50\) m, outside of the plan"):
        _evaluate(replace(suite, tasks=(suite.tasks[0], bad)), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_new_scores_of_the_log_pass_through(suite, tmp_path, monkeypatch, tables_only):
    """A score that is new in an episode's log becomes a column; rows without it have null there."""
    real = EpisodeLog.result

    def more(self):
        return {**real(self), **({"new_score": np.float64(0.25)} if self.steps < 25 else {})}

    monkeypatch.setattr(EpisodeLog, "result", more)
    _evaluate(suite, tmp_path, policies=[])
    assert pq.read_table(tmp_path / "episodes.parquet")["new_score"].to_pylist() == [0.25, None]


class _Page(HTMLParser):
    """Collects what a browser would load, and checks that tags close in order."""

    def __init__(self):
        super().__init__()
        self.sources, self.open = [], []

    def handle_starttag(self, tag, attrs):
        self.sources += [value for name, value in attrs if name in ("src", "href")]
        if tag not in ("meta", "img", "br", "!doctype"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def test_the_report_needs_no_other_file(suite, tmp_path):
    """Pictures are inside, as PNG data; no address; each task has its picture, each episode its command."""
    result = _evaluate(suite, tmp_path)
    text = (tmp_path / "report.html").read_text()
    page = _Page()
    page.feed(text)
    assert page.open == []
    assert "http" not in text.replace("robosim", "")
    inside = [source for source in page.sources if not source.startswith("#")]
    assert [source for source in page.sources if source.startswith("#")] == ["#task-0", "#task-1"]
    assert len(inside) == 2
    for source in inside:
        head, data = source.split(",")
        assert head == "data:image/png;base64"
        assert min(Image.open(io.BytesIO(base64.b64decode(data))).size) > 200
    assert text.count("robosim episode ") == len(result.rows)
    stored = json.loads((tmp_path / "summary.json").read_text())["summary"]
    assert stored[0]["policy"] == "oracle"


def test_the_report_is_made_from_the_episodes_alone(suite, tmp_path, monkeypatch):
    """Neither plan nor building is there when it is drawn a second time, and it is the same, byte for byte."""
    result = _evaluate(suite, tmp_path)
    first = (tmp_path / "report.html").read_bytes()
    (tmp_path / "report.html").unlink()
    for plan in (tmp_path / "plans").iterdir():
        plan.unlink()
    for name in ("robosim.evaluation.episodes.make_building", "robosim.evaluation.episodes.read_plan"):
        monkeypatch.setattr(name, None)
    write_results(result, tmp_path, config=CONFIG, options="", workers=1, console=QUIET)
    assert (tmp_path / "report.html").read_bytes() == first


def test_policies_that_are_files_have_names_of_their_own(tmp_path):
    """An episode's file lies in the folder of its plan, whatever folder the policy's weights are in; weights count."""
    path = tmp_path / "search.safetensors"
    row = {"plan": "flat", "task": 3, "policy": str(path), "repeat": 0}
    assert name_of(row).count("/") == 1 and name_of(row).startswith("flat/003-")
    assert name_of(row) != name_of(row | {"policy": str(tmp_path / "other" / "search.safetensors")})
    digests = set()
    for content in (b"one", b"other"):
        path.write_bytes(content)
        digests.add(code_digest(["snr", str(path)]))
    assert len(digests | {code_digest(["snr"]), code_digest()}) == 3


def test_by_plan_draws_plans_whose_tasks_are_alike():
    """Eight plans of ten tasks that agree within a plan: the interval is that of eight values, not of eighty."""
    of_plan = np.random.default_rng(2).normal(size=8)
    values, plans = np.repeat(of_plan, 10)[:, None], [f"home {i}" for i in range(8) for _ in range(10)]
    apart, together = bootstrap(values, None), bootstrap(by_plan(values, plans), None)
    assert together.value == pytest.approx(apart.value)
    assert together == pytest.approx(bootstrap(of_plan[:, None], None))
    assert together.high - together.low > 2.5 * (apart.high - apart.low)
    assert len(by_plan(values[:40], plans[:40])) == 40  # of four plans tasks are drawn
