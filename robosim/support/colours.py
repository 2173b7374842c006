"""Colours of what pictures of plans, radio and episodes show.

Those of link states are from the palette of Okabe and Ito (2008), which colour-blind people can tell apart.
"""

WALL = "#56B4E9"
FURNISHING = "#8C6D46"
TRUE = "#009E73"
ESTIMATE = "#E69F00"
TARGET = "#D55E00"

#: Name and colour of each `wireless.paths.LinkCategory`, and so of each link state, in all pictures and tables.
LINK_CATEGORIES = {
    0: ("outage", "#787878"),
    1: ("line of sight", "#009E73"),
    4: ("obstructed line of sight", "#CC79A7"),
    2: ("first-order NLOS", "#0072B2"),
    3: ("higher-order NLOS", "#D55E00"),
}
