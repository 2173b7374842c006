"""Numbers for layout and furniture of homes and offices."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Style:
    """Layout and furniture of a kind of building."""

    aspect: tuple[float, float]
    """Long over short side of the building, least and most."""
    corridor_chance: float
    """Chance that a building of four rooms or more has a corridor."""
    corridor_m: tuple[float, float]
    """Width of corridors."""
    narrowest_m: float
    """Smallest side of a room, between wall axes."""
    uneven: float
    """Spread of room sizes: standard deviation of their logarithm."""
    left_out: float
    """Largest share of pieces that are no rooms."""
    loops: float
    """Chance of a second door where two rooms are neighbours."""
    open_plan: float
    """Chance that two social rooms share a wide opening instead of a door."""
    recess: float
    """Chance of an alcove or bay, for each free side of a room."""
    slanted: float
    """Chance of a slanted wall, for each room."""
    crowding: float
    """Number of pieces of the usual furniture, relative to the lists of pieces."""


HOME = Style(
    aspect=(1.0, 1.8),
    corridor_chance=0.5,
    corridor_m=(0.9, 1.5),
    narrowest_m=1.5,
    uneven=0.65,
    left_out=0.35,
    loops=0.35,
    open_plan=0.8,
    recess=0.15,
    slanted=0.1,
    crowding=1.5,
)
OFFICE = Style(
    aspect=(1.0, 2.5),
    corridor_chance=1.0,
    corridor_m=(1.6, 2.4),
    narrowest_m=2.4,
    uneven=0.35,
    left_out=0.1,
    loops=0.05,
    open_plan=0.3,
    recess=0.05,
    slanted=0.04,
    crowding=0.75,
)
STYLES = {"home": HOME, "office": OFFICE}
