"""Options of reading a floor plan, for all formats."""

from dataclasses import dataclass
from typing import Literal

from robosim.plans.floorplan import MapReading

UpAxis = Literal["auto", "y", "z"]


@dataclass(frozen=True, kw_only=True)
class ReadingOptions:
    """Options of reading a floor plan; a reader uses those of its format. What is None depends on the format."""

    resolution_m: float | None = None
    """Side of a cell [m]; needed for images and arrays, not allowed for ROS maps, 0.05 for others if not given."""
    floor_height_m: float | None = None
    """For meshes: height of the storey's floor above the mesh's own zero [m], to within half a metre; None for the
    lowest storey."""
    slice_m: tuple[float, float] = (0.2, 1.5)
    """For meshes: heights above the floor between which nothing may stand in free cells [m]: above doorsills and rugs,
    below lintels."""
    up: UpAxis = "auto"
    """For meshes: the axis that points up; "auto" is y for glTF and z for others, unless the other one of the two has a
    floor more than twice as large."""
    unit_m: float | None = None
    """For meshes: the file's unit of length [m], for example 0.001 for millimetres; None for metres, which is an error
    if the building is implausibly large then."""
    ground_m: float | None = None
    """For meshes without a floor: height of level ground below all of it [m]."""
    thinnest_wall_m: float | None = None
    """For images: dark strokes thinner than this are not walls but text, door arcs or furniture, and become free [m];
    None if all are walls."""
    allow_large: bool = False
    """For images and arrays: confirms a building longer than 500 m."""
    map_reading: MapReading = "common"
    """For ROS maps: "common" reads a common grey as unknown where map_server's thresholds would make it free, with a
    warning; "letter" uses the thresholds alone."""
