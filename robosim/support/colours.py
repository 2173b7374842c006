"""Colours of what pictures of plans and episodes show: one table for all of them, safe for the colour-blind.

Link states keep at least 23 units of CIELAB apart from each other, from walls and from white, with normal sight and
with each of the three dichromacies (Machado et al., A physiologically-based model for simulation of color vision
deficiency, 2009). Blue, sky blue and orange are of Okabe and Ito (2008).
"""

from wireless.paths import LinkCategory

Colour = tuple[int, int, int]

WALL = "#56B4E9"
FURNISHING = "#8C6D46"
TRUE = "#009E73"
ESTIMATE = "#E69F00"
TARGET = "#D55E00"

#: Names and colours of each link category, and so of each link state, in all pictures and tables.
STATE_NAMES: dict[int, str] = {
    LinkCategory.OUTAGE: "outage",
    LinkCategory.LOS: "line of sight",
    LinkCategory.OBSTRUCTED_LOS: "obstructed line of sight",
    LinkCategory.FIRST_ORDER: "first-order NLOS",
    LinkCategory.HIGHER_ORDER: "higher-order NLOS",
}
STATE_COLOURS: dict[int, Colour] = {
    LinkCategory.OUTAGE: (120, 120, 120),
    LinkCategory.LOS: (0, 114, 178),
    LinkCategory.OBSTRUCTED_LOS: (91, 25, 102),
    LinkCategory.FIRST_ORDER: (86, 180, 233),
    LinkCategory.HIGHER_ORDER: (230, 159, 0),
}
#: Colours of the robots of a team, in their order: those of Okabe and Ito (2008), without that of walls.
ROBOTS: tuple[Colour, ...] = (
    (0, 158, 115),
    (213, 94, 0),
    (0, 114, 178),
    (204, 121, 167),
    (230, 159, 0),
    (91, 25, 102),
    (20, 20, 20),
    (140, 109, 70),
)


def robot_colour(number: int) -> Colour:
    """Colour of a robot of a team by its number from 0."""
    return ROBOTS[number % len(ROBOTS)]


def css(colour: Colour) -> str:
    """A colour in hexadecimal, as style sheets and matplotlib take it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
