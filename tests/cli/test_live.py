"""`robosim live` as it is typed: what it says, how it ends, and what it rejects."""

import json
import os
import signal
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Iterator

import pytest

from robosim.plans.floorplan import FloorPlan

pytest.importorskip("viser", reason="needs viser: pip install -e '.[live]'")


@pytest.fixture
def live(tmp_path) -> Iterator[Callable[..., subprocess.Popen]]:
    """Starts the command with a free port and no browser, and ends it with the test."""
    started = []

    def start(*words: object) -> subprocess.Popen:
        # Output has to come through a pipe at once, without a word to Python.
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
        command = [
            sys.executable,
            "-m",
            "robosim",
            "live",
            *map(str, words),
            "--port",
            "0",
            "--no-browser",
            "--json",
        ]
        started.append(
            subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
            )
        )
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_it_serves_until_it_is_stopped_and_ends_without_a_word(live, plan_file, number, status):
    process = live(plan_file)
    output = json.loads(process.stdout.readline())
    assert output["url"].startswith("http://127.0.0.1:") and output["shown"] == "two rooms"
    with urllib.request.urlopen(output["url"], timeout=60) as answer:
        assert b"<html" in answer.read()
    process.send_signal(number)
    out, error = process.communicate(timeout=60)
    assert (process.returncode, out) == (status, "")
    assert "Traceback" not in error and "viser" not in error


def test_a_port_in_use_is_rejected_before_any_work(plan_file, fails):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        message = fails("live", plan_file, "--port", port, "--no-browser")
    assert (
        f"port {port} at 127.0.0.1 is in use by another program. Give another, such as --port {port + 1}"
        in message
    )


def test_a_folder_of_nothing_is_rejected(tmp_path, fails):
    assert "neither an episode (episode.npz) nor an evaluation" in fails("live", tmp_path, "--port", 0)


def test_robots_of_a_recording_and_no_robots_are_rejected(tmp_path, fails):
    assert "is a recording of its robots. Leave --robots out" in fails("live", tmp_path, "--robots", 2)
    command = ("live", tmp_path, "--people", 5, "--export", tmp_path / "a.html")
    assert "is a recording of its people. Leave --people out" in fails(*command)
    assert "robots is '0', expected 1 to 100" in fails("live", "flat", "--robots", 0, "--no-browser")


def test_a_plan_that_cannot_be_read_is_rejected(tmp_path, fails):
    (tmp_path / "damaged.yaml").write_text("image: no.pgm\nresolution: 0.05\norigin: [0, 0, 0]")
    assert "no.pgm" in fails("live", tmp_path / "damaged.yaml", "--port", 0)


def test_an_episode_is_exported_to_one_file(plan_file, tmp_path, capsys):
    from robosim.cli import main

    quick = (
        "--goal explore --physics kinematic --mapper classical --camera embree --image.width 32 --max-steps 4"
    )
    main(f"episode {plan_file} {quick} --no-video --out {tmp_path}/out".split())
    main(f"live {tmp_path}/out --export {tmp_path}/page.html".split())
    assert "plays in any browser" in capsys.readouterr().out
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "__VISER_EMBED_DATA__" in page and "explore, two rooms" in page
    assert not [path for path in tmp_path.iterdir() if "partial" in path.name]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--port 65536", "port is 65536, expected a whole number from 0 to 65535"),
        ("--port -1", "port is -1"),
        ("--host 192.0.2.1", "host is '192.0.2.1', which is no address of this machine"),
        ("--export page.html", "expected a name that ends in .html, and the folder of an episode"),
        ("--frequency-ghz 0", "frequency_hz is 0.0"),
        ("--tolerance 1", "tolerance_m is 1.0"),
    ],
)
def test_nonsense_is_rejected_before_any_work(words, said, monkeypatch, tmp_path, fails):
    def work(self) -> None:
        raise AssertionError("a plan was read before the options were")

    monkeypatch.setattr(FloorPlan, "__post_init__", work)
    monkeypatch.chdir(tmp_path)
    assert said in fails("live", "flat", *words.split())
    assert list(tmp_path.iterdir()) == []
