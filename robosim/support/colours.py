"""Colours of what pictures of plans and episodes show: one table for all of them, safe for the colour-blind.

Link states keep at least 23 units of CIELAB apart from each other, from walls and from white, with normal sight and
with each of the three dichromacies (Machado et al., A physiologically-based model for simulation of color vision
deficiency, 2009). Blue, sky blue and orange are of Okabe and Ito (2008).
"""

from wireless.paths import LinkState

Colour = tuple[int, int, int]

WALL = "#56B4E9"
FURNISHING = "#8C6D46"
TRUE = "#009E73"
ESTIMATE = "#E69F00"
TARGET = "#D55E00"

STATE_NAMES = {
    LinkState.OUTAGE: "outage",
    LinkState.LOS: "line of sight",
    LinkState.FIRST_ORDER: "first-order NLOS",
    LinkState.HIGHER_ORDER: "higher-order NLOS",
}
STATE_COLOURS: dict[LinkState, Colour] = {
    LinkState.OUTAGE: (120, 120, 120),
    LinkState.LOS: (0, 114, 178),
    LinkState.FIRST_ORDER: (86, 180, 233),
    LinkState.HIGHER_ORDER: (230, 159, 0),
}
#: Links whose strongest path goes straight through a wall.
OBSTRUCTED_NAME, OBSTRUCTED_COLOUR = "obstructed line of sight", (91, 25, 102)


def css(colour: Colour) -> str:
    """A colour in hexadecimal, as style sheets and matplotlib take it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
