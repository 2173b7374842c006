"""SVG drawings by hand: units, groups, transforms and styles against exact areas; what is rejected."""

import numpy as np
import pytest

from robosim.plans.files import read_plan
from robosim.plans.floorplan import MapError
from tests.robosim.plans.formats.test_line_drawing import FREE_M2, INNER, OUTER, free_m2, is_free

pytest.importorskip("svgelements", reason="needs the extra svg")

SIZE = 'width="6000mm" height="4000mm" viewBox="0 0 600 400"'
NAMES = 'xmlns="http://www.w3.org/2000/svg" xmlns:i="http://www.inkscape.org/namespaces/inkscape"'


def ring(points):
    """A closed path, in centimetres, y down."""
    return "M" + " ".join(f"{100 * x:g},{400 - 100 * y:g}" for x, y in points) + "Z"


WALLS = f'<path fill-rule="evenodd" d="{ring(OUTER)} {ring(INNER)}"/>'


def save(folder, content, head=SIZE):
    (folder / "house.svg").write_text(f"<svg {NAMES} {head}>{content}</svg>")
    return folder / "house.svg"


@pytest.mark.parametrize(
    ("head", "unit_m"),
    [
        (SIZE, None),
        ('width="236.2204724in" height="157.480315in" viewBox="0 0 600 400"', None),
        ('width="600" height="400"', 0.01),
        ('viewBox="0 0 600 400"', 0.01),
        ('width="60mm" height="40mm" viewBox="0 0 600 400"', 0.01),
    ],
)
def test_units_of_the_picture_or_given(tmp_path, head, unit_m):
    plan = read_plan(save(tmp_path, WALLS, head), unit_m=unit_m)
    assert free_m2(plan) == pytest.approx(FREE_M2)
    assert plan.centres(plan.free).min(axis=0) == pytest.approx([0.225, 0.225])
    assert not is_free(plan, 3.05, 1.0) and is_free(plan, 3.05, 2.5)


@pytest.mark.parametrize(
    "head", ['width="600" height="400"', 'viewBox="0 0 600 400"', 'width="100%" viewBox="0 0 6 4"']
)
def test_a_scale_is_not_guessed(tmp_path, head):
    with pytest.raises(MapError, match=r"does not say how large its units are\. Give it: --unit 0.01"):
        read_plan(save(tmp_path, WALLS, head))


def test_a_sheet_of_paper_is_no_building(tmp_path):
    with pytest.raises(MapError, match=r"0.06 x 0.04 m, too small for a building. Give the unit"):
        read_plan(save(tmp_path, WALLS, 'width="60mm" height="40mm" viewBox="0 0 600 400"'))


@pytest.mark.parametrize(
    "walls",
    [
        f'<g i:label="Walls"><g>{WALLS}</g></g>',
        f'<g id="wall_1" transform="translate(0,400) scale(1,-1) translate(0,400) scale(1,-1)">{WALLS}</g>',
        f'<style>.s{{fill:#222}}</style><g class="Wall External"><path class="s" d="{ring(OUTER)} {ring(INNER)}"/></g>',
        f'<defs><g id="p">{WALLS}</g></defs><g id="Walls"><use href="#p" x="0"/></g>',
    ],
)
def test_walls_by_groups(tmp_path, walls):
    """Labels of Inkscape, ids, classes, transforms, styles and copies; doors and text are left out."""
    more = '<g id="doors"><path d="M300 200 a90 90 0 0 1 90 -90" stroke="black" fill="none"/></g><text>Room</text>'
    assert free_m2(read_plan(save(tmp_path, walls + more))) == pytest.approx(FREE_M2)


def test_strokes_are_as_wide_as_drawn_and_paper_is_light(tmp_path):
    """A frame of 0.2 m by a transformed stroke, a hairline wall, and paper below, all in one group."""
    shapes = (
        '<rect width="600" height="400" fill="#fff"/><rect x="1" y="1" width="58" height="38" fill="none" '
    )
    shapes += 'stroke="black" stroke-width="2" transform="scale(10)"/>'
    plan = read_plan(
        save(tmp_path, shapes + '<line x1="300" y1="0" x2="300" y2="200" stroke="#000" stroke-width="1"/>')
    )
    assert free_m2(plan) == pytest.approx(5.6 * 3.6 - 0.05 * 1.8)


def test_curves(tmp_path):
    """A round room of two arcs: its area to 0.2 %; Bezier curves of a circle likewise."""
    k = 0.5522847 * 150
    bezier = f"M450 200C450 {200 + k} {300 + k} 350 300 350S150 {200 + k} 150 200"
    bezier += f"S{300 - k} 50 300 50S450 {200 - k} 450 200Z"
    for path in ("M150 200A150 150 0 0 0 450 200A150 150 0 0 0 150 200Z", bezier):
        drawn = f'<path d="{path}" fill="none" stroke="black"/>'
        plan = read_plan(save(tmp_path, drawn), resolution_m=0.01)
        assert free_m2(plan) == pytest.approx(np.pi * 1.495**2, rel=2e-3)


def test_what_is_hidden_is_no_wall(tmp_path):
    hidden = '<g display="none"><rect x="200" y="100" width="50" height="50"/></g>'
    hidden += '<rect x="100" y="100" width="50" height="50" visibility="hidden"/>'
    hidden += '<rect x="400" y="100" width="50" height="50" fill-opacity="0"/>'
    plan = read_plan(save(tmp_path, f'<g fill="black">{WALLS}</g>{hidden}'))
    assert free_m2(plan) == pytest.approx(FREE_M2)


def copies(depth):
    """Groups of ten copies of the next."""
    groups = [
        f'<g id="g{i}">' + "".join(f'<use href="#g{i + 1}"/>' for _ in range(10)) + "</g>"
        for i in range(depth)
    ]
    return f'<defs>{"".join(groups)}<g id="g{depth}"><rect width="9" height="9"/></g></defs><use href="#g0"/>'


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (lambda: "", "no lines or areas"),
        (lambda: '<g id="a"><use href="#a"/></g>', "it has a copy"),
        (lambda: copies(9), "more than 100000 shapes"),
        (lambda: "<path", "not readable as an SVG drawing"),
    ],
)
def test_damaged_drawings_are_rejected(tmp_path, content, message):
    with pytest.raises(MapError, match=message):
        read_plan(save(tmp_path, content()))


def test_other_xml_is_rejected(tmp_path):
    (tmp_path / "page.svg").write_text("<html/>")
    with pytest.raises(MapError, match="begins with <html>, expected <svg>"):
        read_plan(tmp_path / "page.svg")


@pytest.mark.parametrize(
    "shape",
    [
        '<circle cx="3" cy="3" r="nan"/>',
        '<line x1="NaN" y1="1" x2="3" y2="3" stroke="black"/>',
        '<path d="M 1 1 L nan 2 L 3 3" stroke="black"/>',
        '<polyline points="1,1 inf,2 3,3" stroke="black"/>',
        '<rect transform="translate(nan,1)" x="1" y="1" width="1" height="1"/>',
        '<path d="M 1 1 L 2 2" stroke="black" stroke-width="nan"/>',
    ],
)
def test_read_svg_rejects_numbers_that_are_nan(tmp_path, shape):
    with pytest.raises(MapError, match="expected finite numbers") as error:
        read_plan(save(tmp_path, f'<g id="wall"><path d="{ring(OUTER)}"/>{shape}</g>'), unit_m=1.0)
    assert ".svg" in str(error.value) and "\n" not in str(error.value)
