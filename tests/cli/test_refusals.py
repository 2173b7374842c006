"""Options that make no sense are rejected before any work: in one line, with status 2, and no folder is left."""

import pytest

from robosim.plans.floorplan import FloorPlan

#: Commands, and words of what is said of them; {} is a folder in which nothing is.
REJECTED = [
    ("episode flat --noise.level nan", "level is nan, expected 0 to 100 times the published noise of motion"),
    ("episode flat --noise.level inf", "level is inf"),
    ("episode flat --noise.level -1", "level is -1.0"),
    (
        "episode flat --depth-noise.level 101",
        "level is 101.0, expected 0 to 100 times the published noise of depth",
    ),
    ("episode flat --image.width 7", "width is 7, expected a whole number from 8 to 4096 pixels"),
    ("episode flat --image.width 5000", "width is 5000"),
    ("episode flat --max-steps 0", "max_steps is 0, expected a whole number from 1 to 1000000"),
    ("episode flat --max-steps 1000001", "max_steps is 1000001"),
    (
        "episode flat --building.tolerance-m 100",
        "tolerance_m is 100.0, expected 0 to 0.5 m. Leave it out for straight walls",
    ),
    ("episode flat --building.tolerance-m -0.1", "tolerance_m is -0.1"),
    ("episode flat --seed -1", "seed is -1, expected a whole number from 0 to 9223372036854775807"),
    ("episode flat --seed 9223372036854775808", "seed is 9223372036854775808"),
    ("episode flat --start 1,2,1e300", "'1,2,1e300', expected X,Y,YAW"),
    ("episode flat --start 1,2,361", "yaw of --start is 361.0, expected -360 to 360 degrees from +x"),
    ("episode flat --target 1e300,0", "'1e300,0', expected X,Y: numbers up to 1e+07"),
    ("episode flat --target here", "'here', expected X,Y"),
    ("episode flat --mapper nural", "mapper is 'nural'. Did you mean 'neural'? Known: neural, classical"),
    ("episode flat --mapper {}/no.safetensors", "but there is no such file"),
    ("episode flat --link-states genrated", "link_states is 'genrated'. Did you mean 'generated'?"),
    ("episode flat --link-states {}/no.safetensors", "but there is no such file"),
    ("episode flat --explorer gian", "explorer is 'gian'. Did you mean 'gain'?"),
    ("episode flat --physics dynmic", "'dynmic'"),
    ("episode flat --resolution nan", "resolution_m is nan, expected 0.001 to 10 m"),
    ("episode flat --unit 0", "unit_m is 0.0"),
    ("episode flat --floor-height inf", "floor_height_m is inf"),
    (
        "episode --robots jackal,turtlebot4 --image.width 32",
        "--image.width is given, but the robots of --robots",
    ),
    ("evaluate --robots jackal,turtlebot4 --lidar=none", "Leave it out, or give their number"),
    ("evaluate flat --robots jackal,jackl", "robots is 'jackl'"),
    ("calibrate --robots 2", "robots is 2: calibrate measures one robot. Give it by --robot"),
    ("replay {} --frames 0", "frames is 0, expected a whole number from 1 to 1000"),
    ("replay {} --frames 1001", "frames is 1001"),
    ("evaluate", "plans is empty, expected floor plans, or folders of them, or a suite file"),
    ("evaluate flat --targets 0", "targets is 0, expected a whole number from 1 to 10000"),
    ("evaluate flat --seeds 10001", "seeds is 10001"),
    ("evaluate flat --seed -1", "seed is -1"),
    ("evaluate flat --workers 1025", "workers is 1025, expected a whole number from 1 to 1024 processes"),
    ("evaluate flat --policies fusd", "policies is 'fusd'. Did you mean 'fused'?"),
    ("evaluate flat --suite-out {}/suite.txt", "expected a name that ends in .yaml, .yml, .json"),
    ("evaluate flat --mapper no.safetensors", "but there is no such file"),
    ("plan flat --radius 0", "radius is 0.0, expected 0.001 to 5 m"),
    ("plan flat --radius nan", "radius is nan"),
    ("plan flat --tolerance 1", "tolerance_m is 1.0"),
    ("trace flat --tx 1,1 --grid 0.001", "grid is 0.001, expected 0.01 to 100 m between receivers"),
    ("trace flat --tx 1,1 --grid nan", "grid is nan"),
    ("trace flat --tx 1,1 --grid 101", "grid is 101.0"),
    ("trace flat --tx 1,1 --rx 1,1", "a path needs some length. Move one of them by 5 mm or more."),
    ("trace flat --tx 1,1 --tx 1,1", "tx (1, 1, 1.5) m is given twice. Leave one of them out."),
    ("trace flat --tx 1,1 --height nan", "height_m is nan"),
    ("trace flat --tx 1,1 --tx-power-dbm 1e300", "tx_power_dbm is 1e+300"),
    ("trace flat --tx 1,1 --threshold-dbm inf", "threshold_dbm is inf, expected -400 to 200 dBm"),
    ("trace flat --tx 1,1 --frequency-ghz 0", "frequency_hz is 0.0"),
    ("dataset", "plans is empty and generated is 0"),
    ("dataset --generated -1", "generated is -1"),
    ("dataset --generated 100001", "generated is 100001"),
    ("dataset flat --tx-per-plan 0", "tx_per_plan is 0"),
    ("dataset flat --grid 0", "grid_m is 0.0"),
    ("dataset flat --seed -1", "seed is -1"),
    ("generate --count 0", "count is 0, expected a whole number from 1 to 100000 plans"),
    ("generate --count 100001", "count is 100001"),
    ("generate --seed -1", "seed is -1"),
    ("collect --homes 0", "homes is 0"),
    ("collect --homes 100001", "homes is 100001"),
    ("collect --steps 10001", "steps is 10001"),
    ("collect --noise nan", "level is nan"),
    ("collect --depth-noise 1e9", "level is 1000000000.0"),
    ("train link-state --data {} --folds 4 --n-folds 3", "folds is 4, expected at most n_folds = 3"),
    ("train link-state --data {} --n-folds 0", "n_folds is 0"),
    ("train link-state --data {} --members 0", "members is 0"),
    ("train link-state --data {} --homes -1", "homes is -1"),
    ("train link-state --data {} --homes 0 --epochs 0", "epochs is 0"),
    ("train link-state --data {} --test {}/no", "which is not a folder"),
    ("train mapper", "data is missing"),
    ("train mapper --data {}/no", "which is not a folder. Make one with `robosim collect`"),
    ("train mapper --smoke --steps 0", "steps is 0"),
    ("train mapper --smoke --batch 0", "batch is 0"),
    ("train mapper --smoke --widths 0", "widths is 0"),
    ("train mapper --smoke --widths 8 8 8 8 8 8 8 8", "expected one to seven numbers of channels"),
    ("train mapper --smoke --threads 0", "threads is 0, expected a whole number from 1 to 1024 threads"),
    ("train mapper --smoke --seed -1", "seed is -1"),
    ("train explorer --rounds 0", "rounds is 0"),
    ("train explorer --held-out 10001", "held_out is 10001, expected a whole number from 1 to 10000 homes"),
    ("train explorer --decisions 0", "decisions is 0"),
    ("train search --homes 0", "homes is 0"),
    ("epsiode flat", "the command is 'epsiode'. Did you mean 'episode'?"),
    ("train serach", "the command is 'serach'. Did you mean 'search'?"),
    ("episode flat --goal nowhere.safetensors", "nowhere.safetensors"),
    ("episode flat --radio.tables {}", "tables is set, but engine is 'live'"),
    (
        "episode flat --robot jackal --depth-noise.level 1",
        "--depth-noise.level is given, but the robot has no camera",
    ),
]


@pytest.fixture
def no_work(monkeypatch, tmp_path) -> None:
    """Reading, inventing or building anything would fail, and what is left by default is left here."""

    def work(self) -> None:
        raise AssertionError("a plan was read before the options were")

    monkeypatch.setattr(FloorPlan, "__post_init__", work)
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("command", "words"), REJECTED)
@pytest.mark.usefixtures("no_work")
def test_nonsense_is_rejected_before_any_work(command, words, tmp_path, fails):
    folder = tmp_path / "given"
    folder.mkdir()
    message = fails(*command.format(*[folder] * 4).split(), "--out", tmp_path / "out/deep")
    assert words in message.replace(" │", "").replace("│ ", "")
    assert "0x" not in message
    assert [path.name for path in tmp_path.rglob("*")] == ["given"]


#: Commands that begin, and find that what they are given does not do.
FRUITLESS = [
    ("plan {}/damaged.yaml", "no.pgm"),
    ("episode {}/damaged.yaml", "no.pgm"),
    ("episode {plan} --target 3.1,0.5", "the target (3.1, 0.5) m is in a wall, or outside of the building"),
    ("episode {plan} --start 3.1,0.5,0", "does not fit at the start (3.1, 0.5) m"),
    ("replay {}", "{}"),
    ("trace {plan} --tx 3.1,0.5", "tx is (3.1, 0.5) m, outside of the free space"),
    ("trace {plan} --tx 1,1 --rx 3.1,0.5", "rx is (3.1, 0.5) m, outside of the free space"),
    ("trace {plan} --tx 1,1 --grid 20", "no receiver fits"),
    ("dataset {}/damaged.yaml", "no.pgm"),
    ("train link-state --data {}", "{}"),
    ("train mapper --data {}", "holds 0 homes"),
]


@pytest.mark.parametrize(("command", "words"), FRUITLESS)
def test_what_came_to_nothing_leaves_no_folder(command, words, plan_file, tmp_path, fails, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "given"
    folder.mkdir()
    (folder / "damaged.yaml").write_text("image: no.pgm\nresolution: 0.05\norigin: [0, 0, 0]")
    for out in (["--out", tmp_path / "out/deep"], []):
        message = fails(*command.format(folder, folder, plan=plan_file).split(), *out)
        assert words.format(folder) in message
        assert sorted(path.name for path in tmp_path.rglob("*")) == ["damaged.yaml", "given"]


def test_a_command_without_a_word_asks_for_what_is_missing(fails):
    """`robosim episode` alone: the plan is required."""
    message = fails("episode")
    assert "Missing from robosim episode" in message and "Floor plan" in message
