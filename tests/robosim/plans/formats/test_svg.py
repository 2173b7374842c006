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
        '<style>.s{fill:#222}</style><g class="Wall External">'
        + WALLS.replace("<path", '<path class="s"')
        + "</g>",
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


POST = '<rect x="200" y="100" width="50" height="50"{}/>'


@pytest.mark.parametrize(
    "hidden",
    [
        POST.format(' visibility="collapse"'),
        f'<g style="opacity:0">{POST.format("")}</g>',
        POST.format(' fill-opacity="0.1"'),
        f'<symbol id="s">{POST.format("")}</symbol>',
        f'<mask id="m">{POST.format("")}</mask><marker>{POST.format("")}</marker>',
        POST.format(' class="a"') + "<style>*{stroke:none}.a{fill:none !important}</style>",
        POST.format(' fill="#000" style="fill: light-dark(rgb(255, 255, 255), var(--dark, #121212));"'),
        POST.format(' class="a"') + "<style>.a{fill:light-dark(#fff, #000)}</style>",
        '<g fill="white">' + POST.format(' fill="inherit"') + POST.format(' style="fill:inherit"') + "</g>",
        POST.format(' style="fill:white !important"'),
    ],
)
def test_read_svg_leaves_out_what_is_not_drawn(tmp_path, hidden):
    """Judged by resvg: definitions draw nothing, and a style sheet applies to what is before it too."""
    assert free_m2(read_plan(save(tmp_path, f'<g id="walls">{WALLS}{hidden}</g>'))) == pytest.approx(FREE_M2)


def test_read_svg_draws_a_symbol_where_it_is_used(tmp_path):
    symbol = '<symbol id="s"><rect width="50" height="50"/></symbol><use href="#s" x="200" y="100"/>'
    plan = read_plan(save(tmp_path, f'<g id="walls">{WALLS}{symbol}</g>'))
    assert free_m2(plan) == pytest.approx(FREE_M2 - 0.25) and not is_free(plan, 2.25, 2.75)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('<symbol id="s" viewBox="0 0 9 9"><path d="M0 0H9V9Z"/></symbol><use href="#s"/>', "1 symbols or"),
        ('<svg x="200" y="100"><path d="M0 0H50V50Z"/></svg>', "1 symbols or"),
        ("<style>.a,g &gt; text{fill:none}</style>", "style sheet for 'g > text' are not read"),
        (
            '<g stroke-dasharray="none" style="stroke-dasharray: 0.5 , 1"/>',
            "by 1 styles with stroke-dasharray",
        ),
        ("<style>.a{fill:none;stroke-dasharray:4}</style>", "by 1 styles with stroke-dasharray"),
        ('<g transform="rotate(9)" style="transform-origin: 3px 2px"/>', "shapes of 1 styles may lie"),
        ('<g transform="rotate(9)" transform-origin="3 2"/>', "shapes of 1 styles may lie"),
        ('<g fill="rgb(9.5,9,9)" style="fill:rgb(9 9 9 / 5%)"/>', "2 colours such as 'rgb(9"),
    ],
)
def test_read_svg_warns_of_what_it_leaves_out(tmp_path, caplog, content, message):
    plan = read_plan(save(tmp_path, f'<g id="walls">{WALLS}{content}</g>'))
    assert free_m2(plan) == pytest.approx(FREE_M2)
    assert message in caplog.text and "house.svg" in caplog.text


def test_read_svg_turns_rectangles_and_ellipses(tmp_path):
    """A bar of 2 m x 0.2 m turned by 90 degrees about (3, 2), a mirrored one, and an outline 0.2 m wide."""
    turned = '<rect x="200" y="190" width="200" height="20" transform="rotate(90 300 200)"/>'
    mirrored = '<rect x="-550" y="100" width="100" height="20" transform="scale(-1 1)"/>'
    ring = (
        '<ellipse cx="8" cy="-14" rx="1" ry="4" fill="none" stroke="black" stroke-width="2" transform="{}"/>'
    )
    plan = read_plan(
        save(tmp_path, f'<g id="walls">{WALLS}{turned}{mirrored}{ring.format("scale(10) rotate(90)")}</g>')
    )
    assert not is_free(plan, 3.0, 2.9) and is_free(plan, 2.2, 2.0)
    assert not is_free(plan, 5.0, 2.9) and is_free(plan, 5.0, 3.1)
    assert not is_free(plan, 0.93, 3.2) and is_free(plan, 0.83, 3.2)


@pytest.mark.parametrize(
    ("inner", "rule", "filled_m2"),
    [
        ("H250V250H150Z", "nonzero", 4.0),
        ("V250H250V150Z", "nonzero", 3.0),
        ("H250V250H150Z", "evenodd", 3.0),
    ],
)
def test_read_svg_fills_by_the_nonzero_rule_unless_said(tmp_path, inner, rule, filled_m2):
    """A square in a square is a hole if it turns the other direction, or by evenodd (SVG 2, 13.4.2)."""
    drawn = f'<path fill-rule="{rule}" d="M100 100H300V300H100ZM150 150{inner}"/>'
    plan = read_plan(save(tmp_path, f'<g id="walls">{WALLS}{drawn}</g>'))
    assert is_free(plan, 2.0, 2.0) == (filled_m2 == 3.0)
    assert free_m2(plan) == pytest.approx(FREE_M2 - filled_m2)


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


@pytest.mark.parametrize("rule", ["nonzero", "evenodd"])
def test_the_middle_of_a_star_is_filled_by_the_nonzero_rule(tmp_path, rule):
    """SVG 2, 13.4.2: the outline of a pentagram, which crosses itself, winds twice around its middle."""
    angle = np.pi / 2 + 2 * np.arange(5) * 2 * np.pi / 5
    star = ring(np.column_stack([1.5 + np.cos(angle), 2 + np.sin(angle)]))
    plan = read_plan(save(tmp_path, f'<g id="walls">{WALLS}<path fill-rule="{rule}" d="{star}"/></g>'))
    assert is_free(plan, 1.5, 2.0) == (rule == "evenodd")
    assert not is_free(plan, 1.5, 2.6) and is_free(plan, 1.5, 1.5)
