"""Large buildings: connected, with long corridors, rings and dead ends, and rooms of usual size along corridors."""

import os
import subprocess
import sys

import numpy as np
import pytest
import shapely
from scipy import ndimage

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.generator.generate import GeneratorConfig, generate_plan
from robosim.generator.layout import Layout, lay_out
from robosim.generator.wings import LARGE_STYLES

STYLES = sorted(LARGE_STYLES)


def layouts(style: str, area_m2: float, n: int = 8) -> list[Layout]:
    return [
        lay_out(
            np.random.default_rng(seed),
            area_m2=area_m2,
            rooms=1,
            door_m=(0.7, 1.0),
            style=LARGE_STYLES[style],
        )
        for seed in range(n)
    ]


def areas(layout: Layout, *kinds: str) -> list[float]:
    return [room.floor.area for room in layout.rooms if room.kind in kinds]


@pytest.mark.parametrize("style", STYLES)
def test_generate_plan_connects_a_large_building_for_the_hull(style: str):
    """By the building's walls: nearly all places of the hull are one component, and free cells are one."""
    for seed, area_m2 in ((1, 1000.0), (2, None)):
        plan = generate_plan(seed, config=GeneratorConfig(style=style, area_m2=area_m2, rotation_deg=0))
        assert ndimage.label(plan.free)[1] == 1
        sizes = np.bincount(reach(make_building(plan), 0.18).parts.ravel())[1:]
        assert sizes[0] > 0.98 * sizes.sum()


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("area_m2", [1000.0, 5000.0])
def test_lay_out_has_the_requested_area_and_openings_to_each_room(style: str, area_m2: float):
    """Floors add up to the area, do not overlap, and openings join all of them, corridors among each other too."""
    for layout in layouts(style, area_m2):
        floors = [room.floor for room in layout.rooms]
        assert sum(floor.area for floor in floors) == pytest.approx(area_m2)
        boxes = shapely.box(*np.array(floors).T)
        assert shapely.union_all(boxes).area == pytest.approx(area_m2)
        for joints in (
            [opening.rooms for opening in layout.openings],
            [o.rooms for o in layout.openings if {layout.rooms[i].kind for i in o.rooms} == {"hall"}],
        ):
            reached = {next(i for i, room in enumerate(layout.rooms) if room.kind == "hall")}
            for _ in layout.rooms:
                reached |= {i for pair in joints for i in pair if reached & set(pair)}
            halls = {i for i, room in enumerate(layout.rooms) if room.kind == "hall"}
            assert reached >= halls
            assert len(reached) == len(layout.rooms) or reached == halls


@pytest.mark.parametrize("style", ["campus", "school", "hospital"])
def test_lay_out_draws_long_corridors_rings_and_dead_ends(style: str):
    """In 5,000 m2: corridors of 50 to 100 m, three or more of them; rings and dead ends in many buildings."""
    rings = ends = 0
    for layout in layouts(style, 5000.0, 12):
        corridors = [i for i, room in enumerate(layout.rooms) if room.kind == "hall"]
        assert len(corridors) >= 3
        assert 50 < max(max(layout.rooms[i].floor.size) for i in corridors) <= 100
        joints = [o.rooms for o in layout.openings if set(o.rooms) <= set(corridors)]
        rings += len(joints) >= len(corridors)
        degrees = np.bincount(np.ravel(joints), minlength=len(layout.rooms))[corridors]
        ends += bool((degrees == 1).any())
    assert rings >= 3 and ends >= 3


def test_lay_out_gives_rooms_their_usual_size():
    """Medians of rooms in 5,000 m2: classrooms 50 to 70 m2, wards 15 to 25, offices 10 to 25, halls above 400."""
    for style, kind, least, largest in (
        ("school", "classroom", 50, 70),
        ("hospital", "bedroom", 15, 25),
        ("campus", "office", 10, 25),
        ("hall", "great hall", 400, 1900),
    ):
        sizes_m2 = [area for layout in layouts(style, 5000.0) for area in areas(layout, kind)]
        assert least < np.median(sizes_m2) < largest, style


@pytest.mark.parametrize("style", ["campus", "school", "hospital"])
def test_lay_out_joins_rooms_to_corridors(style: str):
    """More than 85 % of the rooms have a door to a corridor; the others are behind another room or at a hall."""
    for layout in layouts(style, 3000.0):
        kinds = [room.kind for room in layout.rooms]
        at_corridor = {i for o in layout.openings for i in o.rooms if "hall" in {kinds[k] for k in o.rooms}}
        rooms = {i for i, kind in enumerate(kinds) if kind != "hall"}
        assert len(at_corridor & rooms) > 0.85 * len(rooms)


def test_generate_plan_sets_posts_in_halls():
    """Posts of 0.25 to 0.6 m stand apart from walls in most halls, and are solid in the plan."""
    counts = [len(layout.wedges) for layout in layouts("hall", 3000.0)]
    assert sum(count >= 6 for count in counts) >= 4
    plan = generate_plan(1, config=GeneratorConfig(style="hall", rotation_deg=0, furniture=0, area_m2=3000))
    labels, _ = ndimage.label(~plan.free)
    sizes_m2 = np.bincount(labels.ravel())[1:] * 0.05**2
    assert (sizes_m2 < 0.6).sum() >= 6


def test_generate_plan_repeats_large_buildings_in_other_processes():
    code = (
        "from robosim.generator.generate import *\n"
        "for style in ('school', 'hall'):\n"
        "    print(generate_plan(3, config=GeneratorConfig(style=style, area_m2=1000)).digest())"
    )
    environment = {**os.environ, "PYTHONHASHSEED": "77"}
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    here = [
        generate_plan(3, config=GeneratorConfig(style=style, area_m2=1000)).digest()
        for style in ("school", "hall")
    ]
    assert run.stdout.split() == here


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"style": "hospital", "area_m2": 300.0},
            "area_m2 of style hospital is 300.0, expected 1000 to 5000",
        ),
        ({"style": "school", "rooms": 30}, "rooms is 30, but style school .* Set area_m2 instead"),
    ],
)
def test_generator_config_rejects_what_large_buildings_lack(wrong: dict, message: str):
    with pytest.raises(ValueError, match=message):
        GeneratorConfig(**wrong)
