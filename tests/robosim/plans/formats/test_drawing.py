"""Pictures as estate agents draw them: what is no wall is dropped, and walls stay within a cell."""

import logging
import math

import cv2
import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.cli import main
from robosim.plans.files import read_plan
from robosim.plans.floorplan import FREE, MapError

#: Thickness of walls, and of the white paper around the house [m].
WALL_M, PAPER_M = 0.2, 1.5
WIDTH_M, DEPTH_M = 10.0, 8.0


class Drawing:
    """A house of three rooms with its front door open, drawn on white paper at a scale.

    Args:
        resolution_m: Side of a pixel [m].
        wall_m: Thickness of its walls [m].
    """

    def __init__(self, resolution_m: float, wall_m: float = WALL_M) -> None:
        self.resolution_m, self.scale = resolution_m, 1 / resolution_m
        shape = [round((side + 2 * PAPER_M) * self.scale) for side in (DEPTH_M, WIDTH_M)]
        self.pixels = np.full((*shape, 3), 255, np.uint8)
        t, w, d = wall_m, WIDTH_M, DEPTH_M
        for wall in [(0, 0, w, t), (0, d - t, w, d), (0, 0, t, d), (w - t, 0, w, d)]:
            self.fill(*wall, 0)
        for wall in [(5, 0, 5 + t, 3), (5, 4, 5 + t, d), (5, 4, 7, 4 + t), (8, 4, w, 4 + t)]:
            self.fill(*wall, 0)
        self.fill(2, d - t, 2.9, d, 255)
        self.walls = self.pixels[..., 0] < 128

    def at(self, x: float, y: float) -> tuple[int, int]:
        return round((x + PAPER_M) * self.scale), round((y + PAPER_M) * self.scale)

    def fill(self, x0: float, y0: float, x1: float, y1: float, grey: int) -> None:
        (left, top), (right, bottom) = self.at(x0, y0), self.at(x1, y1)
        self.pixels[top:bottom, left:right] = grey

    def furnish(self) -> "Drawing":
        """Text, door arcs with their leaves, a table, a bed and a sofa, all in strokes of 3 cm."""
        stroke = max(1, round(0.03 * self.scale))
        how = {"color": (0, 0, 0), "thickness": stroke, "lineType": cv2.LINE_AA}
        for text, place, size in [
            ("LIVING", (1, 2), 0.02),
            ("BED", (5.8, 6), 0.012),
            ("80 m2", (3, -0.2), 0.015),
        ]:
            cv2.putText(
                self.pixels,
                text,
                self.at(*place),
                cv2.FONT_HERSHEY_SIMPLEX,
                max(0.6, size * self.scale),
                **how,
            )
        radius = (int(0.9 * self.scale),) * 2
        for x, y, end in [(5.1, 3, 90), (7, 4.1, -90), (2, 7.9, -90)]:
            cv2.ellipse(self.pixels, self.at(x, y), radius, 0, 0, end, **how)
            cv2.line(self.pixels, self.at(x, y), self.at(x + 0.9, y), **how)
        cv2.rectangle(self.pixels, self.at(1, 4), self.at(2.6, 5), **how)
        cv2.rectangle(self.pixels, self.at(8, 5), self.at(9.6, 7), **how)
        cv2.circle(self.pixels, self.at(3.8, 6), int(0.5 * self.scale), **how)
        return self

    def framed(self, frame: str | None) -> "Drawing":
        """A line around the paper, a line within it, or a dark table below it."""
        height, width = self.walls.shape
        if frame == "line":
            cv2.rectangle(self.pixels, (0, 0), (width - 1, height - 1), (0, 0, 0), 2)
        if frame == "grey line":
            cv2.rectangle(self.pixels, (0, 0), (width - 1, height - 1), (200, 200, 200), 1)
        if frame == "inset":
            cv2.rectangle(self.pixels, (9, 9), (width - 10, height - 10), (0, 0, 0), 1)
        if frame == "table":
            self.pixels = np.pad(self.pixels, ((40, 30), (60, 50), (0, 0)), constant_values=60)
            self.walls = np.pad(self.walls, ((40, 30), (60, 50)))
        return self

    def save(self, folder, quality: int | None = None):
        path = folder / ("plan.png" if quality is None else "plan.jpg")
        ok, content = cv2.imencode(path.suffix, self.pixels, [cv2.IMWRITE_JPEG_QUALITY, quality or 0])
        assert ok
        path.write_bytes(content.tobytes())
        return path


@pytest.mark.parametrize("quality", [None, 60])
@pytest.mark.parametrize("frame", [None, "line", "grey line", "inset", "table"])
@pytest.mark.parametrize("resolution_m", [0.01, 0.02, 0.05])
def test_strokes_and_frames_are_no_walls(tmp_path, resolution_m, frame, quality):
    """Walls are within a cell, and where strokes meet them 0.2 m2 more at most; the rooms are what is within.

    Without the option text, arcs and furniture block 1.5 m2 and more.
    """
    drawing = Drawing(resolution_m).furnish().framed(frame)
    plan = read_plan(drawing.save(tmp_path, quality), resolution_m=resolution_m, thinnest_wall_m=0.12)
    blocked, walls = plan.occupancy[::-1] != FREE, drawing.walls.astype(np.uint8)
    assert blocked[cv2.erode(walls, np.ones((3, 3))) > 0].all()
    far = cv2.distanceTransform(1 - walls, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[blocked]
    assert far.max() <= max(4.0, 0.2 / resolution_m)
    assert (far > 1.5).sum() * resolution_m**2 < 0.05
    building = make_building(plan)
    # By hand: 9.6 x 7.6 less walls between of 2.8 + 3.8, 1.8 and 1.8 m, and the front door's passage.
    assert building.indoor_m2 == pytest.approx(72.96 - 0.2 * (2.8 + 3.8 + 1.8 + 1.8), abs=0.3)
    places = reach(building, 0.1)
    inside = places.parts[places.indoors]
    assert len(np.unique(inside)) == 1, "three rooms behind open doors"
    assert not places.cut_off(1)


def test_what_was_dropped_is_said(tmp_path, caplog):
    path = Drawing(0.02).furnish().save(tmp_path)
    with caplog.at_level(logging.WARNING):
        read_plan(path, resolution_m=0.02)
    assert "are read as walls" in caplog.text and "--thinnest-wall 0.1" in caplog.text
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        read_plan(path, resolution_m=0.02, thinnest_wall_m=0.12)
    assert "thinner than 0.12 m and are not read as walls" in caplog.text and str(path) in caplog.text


@pytest.mark.parametrize("wall_m", [0.05, 0.2])
def test_plans_without_strokes_are_as_they_were(tmp_path, caplog, wall_m):
    """Walls of one cell or four, nothing else: nothing is dropped, nothing is said."""
    drawing = Drawing(0.05, wall_m)
    with caplog.at_level(logging.WARNING):
        plan = read_plan(drawing.save(tmp_path), resolution_m=0.05)
    np.testing.assert_array_equal(plan.occupancy[::-1] != FREE, drawing.walls)
    assert not caplog.text
    slanted = Drawing(0.05, wall_m)
    cv2.line(slanted.pixels, slanted.at(1, 1), slanted.at(4, 6), (0, 0, 0), 1)
    plan = read_plan(slanted.save(tmp_path), resolution_m=0.05)
    np.testing.assert_array_equal(plan.occupancy[::-1] != FREE, slanted.pixels[..., 0] == 0)


@pytest.mark.parametrize("degrees", [0, 20, 45, 63])
@pytest.mark.parametrize("cells", [3, 4, 6])
def test_slanted_walls_are_as_thick_as_upright_ones(tmp_path, cells, degrees):
    """A wall of so many cells across stays for a thinnest wall that is a cell less, and goes for two cells more."""
    pixels = np.full((200, 200), 255, np.uint8)
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    y, x = np.mgrid[:200, :200] - 99.5
    pixels[(np.abs(y * c - x * s) < cells / 2) & (np.abs(x * c + y * s) < 60)] = 0
    pixels[:12] = 0
    cv2.imwrite(str(tmp_path / "wall.png"), pixels)
    wall = np.zeros(pixels.shape, bool)
    wall[20:] = pixels[20:] == 0

    def stored(thinnest_cells):
        plan = read_plan(tmp_path / "wall.png", resolution_m=0.05, thinnest_wall_m=0.05 * thinnest_cells)
        return (plan.occupancy[::-1] != FREE)[wall].mean()

    assert stored(cells - 1) > 0.97
    assert stored(cells + 2) < 0.03


def test_a_single_room_keeps_its_own_walls(tmp_path):
    """A thick wall around all, to which nothing is attached: with nothing but furniture in it, it is no frame."""
    pixels = np.zeros((120, 160), np.uint8)
    pixels[5:-5, 5:-5] = 255
    pixels[50:70, 60:90] = 0
    cv2.imwrite(str(tmp_path / "room.png"), pixels)
    plan = read_plan(tmp_path / "room.png", resolution_m=0.05)
    np.testing.assert_array_equal(plan.free[::-1], pixels == 255)


def test_a_wall_of_strokes_only_is_an_error(tmp_path):
    path = Drawing(0.05, 0.05).save(tmp_path)
    with pytest.raises(MapError, match=r"plan\.png: thinnest wall is 0\.3 m.*--thinnest-wall"):
        read_plan(path, resolution_m=0.05, thinnest_wall_m=0.3)


def test_the_option_is_of_images(tmp_path):
    with pytest.raises(MapError, match="no image"):
        read_plan("flat", thinnest_wall_m=0.1)


def test_a_building_of_a_kilometre_is_confirmed(tmp_path):
    """A photo whose resolution is a slip of the finger, and an array; a hall of 300 m is none."""
    cv2.imwrite(str(tmp_path / "photo.png"), np.full((90, 1200), 255, np.uint8))
    np.save(tmp_path / "array.npy", np.zeros((90, 1200), np.uint8))
    for name in ("photo.png", "array.npy"):
        with pytest.raises(MapError, match=r"1\.2 km long.*--allow-large") as error:
            read_plan(tmp_path / name, resolution_m=1.0)
        assert name in str(error.value) and "\n" not in str(error.value)
        assert read_plan(tmp_path / name, resolution_m=1.0, allow_large=True).shape == (90, 1200)
        assert read_plan(tmp_path / name, resolution_m=0.25).shape == (90, 1200)


def test_a_plan_without_room_for_the_robot_is_an_error(tmp_path, capsys):
    """3 x 3 cells: one line and no hint at what to do next, and no folder of results."""
    cv2.imwrite(str(tmp_path / "tiny.png"), np.full((3, 3), 255, np.uint8))
    with pytest.raises(SystemExit) as error:
        main(["plan", str(tmp_path / "tiny.png"), "--resolution", "0.05", "--out", str(tmp_path / "out")])
    assert error.value.code == 2
    said = capsys.readouterr()
    assert "fits nowhere" in said.err and "Next" not in said.out + said.err
    assert not (tmp_path / "out" / "reach.png").exists()
