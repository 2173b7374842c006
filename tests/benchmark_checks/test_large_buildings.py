"""The suite of large buildings: its plans are the published ones, its tasks those that were evaluated."""

import cv2
import numpy as np
import pytest

from robosim.evaluation.suite import read_suite
from robosim.plans.files import read_plan
from tests.benchmarks import large_buildings
from tests.benchmarks.harness import Options


def write_floor(folder, free, rooms):
    """Pictures of a floor, rows from the top."""
    for name, values in (("occ", 255 * free), ("rooms", rooms)):
        assert cv2.imwrite(str(folder / f"hall_{name}.png"), values.astype(np.uint8))


def test_large_buildings_close_the_outside_and_draw_six_tasks_of_a_floor(tmp_path, in_process):
    """A room of 4 x 2 m in the upper left corner of a picture, with ground around it, is all free floor."""
    free = np.ones((60, 100), bool)
    free[2:46, 2:86] = False
    free[4:44, 4:84] = True
    rooms = np.zeros(free.shape, int)
    rooms[4:44, 4:84] = 1
    write_floor(tmp_path, free, rooms)
    large_buildings.main(tmp_path, count=0, options=Options(out=tmp_path / "large"))
    suite = read_suite(tmp_path / "large" / "campus.yaml")
    plan = read_plan(suite.plans["hall"])
    rows, columns = np.nonzero(plan.free)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (16, 55, 4, 83)
    assert len(rows) == 40 * 80 and plan.resolution_m == 0.05
    assert [(task.plan, task.number) for task in suite.tasks] == [("hall", i) for i in range(6)]


def test_campus_tasks_are_those_that_were_published(shared, tmp_path, in_process):
    """First tasks of two floors, by the description of the floors; angles rounded as there."""
    large_buildings.main(shared / "maps" / "kth", count=0, options=Options(out=tmp_path))
    first = {task.plan: task for task in read_suite(tmp_path / "campus.yaml").tasks if task.number == 0}
    assert len(first) == 7
    for name, start, target in (
        ("50010536_PLAN3", (66.975, 20.025, 59.1), (77.725, 12.125)),
        ("50052749", (9.225, 25.475, 95.82), (18.625, 5.525)),
    ):
        assert first[name].start == pytest.approx(start) and first[name].target == pytest.approx(target)


def test_large_buildings_have_three_tasks_in_each_generated_building(tmp_path, in_process, monkeypatch):
    """A building of two styles, of seeds that follow each other."""
    monkeypatch.setattr(large_buildings, "LARGE_STYLES", ("school", "hall"))
    free = np.pad(np.ones((40, 80), bool), 2)
    write_floor(tmp_path, free, free)
    large_buildings.main(tmp_path, count=1, options=Options(out=tmp_path / "large"))
    suite = read_suite(tmp_path / "large" / "generated.yaml")
    assert set(suite.plans) == {"school-40000000", "hall-40000001"}
    assert len(suite.tasks) == 6
    assert read_plan(suite.plans["hall-40000001"]).free.sum() * 0.05**2 > 700


def test_large_buildings_without_floors_is_an_error(tmp_path):
    with pytest.raises(ValueError, match=r"no NAME_occ.png"):
        large_buildings.main(tmp_path)
