"""The YAML file of a ROS map: its keys, each checked, with messages that say what is expected.

Needed are `image`, `resolution`, `origin`, `negate`, `occupied_thresh` and `free_thresh`, as by map_server;
`mode` may be missing, and so may the yaw in `origin`. `name`, `wall_line`, `eroded_m`, `materials` and `furnishings`
are keys of our own. `materials` says which colours of the image are walls of which radio material, `furnishings` names
the file of what is placed in the building (`robosim.plans.formats.furnishing_file`):

    materials: {"#0000ff": glazing, "#008000": door, "#800000": my_wall.yaml}
    furnishings: room-furnishings.yaml

`robosim.plans.formats.ros_map` describes how they apply to the image.
"""

import logging
import math
import re
import reprlib
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal, get_args

from robosim.parts import MATERIAL
from robosim.plans.floorplan import FARTHEST_M, MOST_YAW, RESOLUTIONS_M, MapError, WallLine
from robosim.plans.formats.thresholds import Thresholds
from robosim.support.reading import reading
from robosim.support.text_in import check_object, parse_yaml

logger = logging.getLogger(__name__)

Mode = Literal["trinary", "scale", "raw"]

#: A map's YAML has some ten lines.
_MAX_YAML_BYTES = 100_000
_WHAT = "the YAML file of a map_server map"
_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxlist, _SHORT.maxdict = 2, 4, 4
_TRUE, _FALSE = ("1", "true", "yes", "on", "y"), ("0", "false", "no", "off", "n")


@dataclass(frozen=True, kw_only=True)
class RosHeader:
    """The checked contents of the YAML file."""

    image: Path
    resolution_m: float
    origin: tuple[float, float, float]
    negate: bool
    thresholds: Thresholds
    mode: Mode
    name: str
    wall_line: WallLine
    eroded_m: float
    materials: dict[tuple[int, int, int], str]
    """Radio material of each colour (red, green, blue) that has one; files with their folder."""
    furnishings: Path | None
    """File of furnishings."""


def read_header(path: Path) -> RosHeader:
    """Read and check the YAML file of a map_server map. Raises MapError as `read_ros` does."""
    remedy = "Write one 'key: value' per line, such as 'image: map.pgm'."
    with reading(path, _WHAT, remedy, most_bytes=_MAX_YAML_BYTES, kind=MapError) as file:
        # Numbers stay text, as in map_server's own parser, by which 5e-2 and "0.05" are numbers too.
        keys = check_object(parse_yaml(file.read(), as_text=True))
        return _checked(_Keys(path, keys))


class _Keys:
    """The keys of one YAML file, each read with a check."""

    def __init__(self, path: Path, keys: dict[Any, Any]):
        self.path, self.keys = path, keys

    def fail(self, key: str, expected: str) -> MapError:
        value = self.keys[key]
        # Nested aliases can make the whole text of a list enormous.
        shown = repr(value[:80]) if isinstance(value, str) else _SHORT.repr(value)
        return MapError(f"{self.path}: {key} is {shown}, expected {expected}.")

    def get(self, key: str, example: str) -> Any:
        if key not in self.keys:
            near = get_close_matches(key, [str(k) for k in self.keys], 1)
            hint = f" Did you mean it by '{near[0]}'?" if near else ""
            raise MapError(
                f"{self.path}: the key '{key}' is missing. Add a line such as '{key}: {example}'.{hint}"
            )
        return self.keys[key]

    def number(self, key: str, example: str, expected: str) -> float:
        number = _number(self.get(key, example))
        if number is None:
            raise self.fail(key, expected)
        return number

    def choice(self, key: str, choices: tuple[str, ...], default: str) -> str:
        value = self.keys.get(key, default)
        if not isinstance(value, str) or value.lower() not in choices:
            raise self.fail(key, "one of " + ", ".join(choices))
        return value.lower()


def _number(value: Any) -> float | None:
    """A finite number written as text, else None."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def _checked(keys: _Keys) -> RosHeader:
    image = _image_path(keys)
    resolution_m = keys.number("resolution", "0.05", "the metres per pixel, for example 0.05")
    low, high = RESOLUTIONS_M
    if not low <= resolution_m <= high:
        raise keys.fail("resolution", f"a positive number from {low:g} to {high:g}: the metres per pixel")
    name = keys.keys.get("name", keys.path.stem)
    eroded_m = keys.number("eroded_m", "0.1", "metres, 0 or more") if "eroded_m" in keys.keys else 0.0
    return RosHeader(
        image=image,
        resolution_m=resolution_m,
        origin=_origin(keys),
        negate=keys.choice("negate", _TRUE + _FALSE, keys.get("negate", "0")) in _TRUE,
        thresholds=_thresholds(keys),
        mode=keys.choice("mode", get_args(Mode), "trinary"),  # type: ignore[arg-type]
        name=name if isinstance(name, str) else keys.path.stem,
        wall_line=keys.choice("wall_line", get_args(WallLine), "cell_edge"),  # type: ignore[arg-type]
        eroded_m=eroded_m,
        materials=_materials(keys),
        furnishings=_furnishings(keys),
    )


def _furnishings(keys: _Keys) -> Path | None:
    if "furnishings" not in keys.keys:
        return None
    value = keys.keys["furnishings"]
    if not isinstance(value, str) or not value.strip() or "\0" in value:
        raise keys.fail("furnishings", "the name of a YAML file, for example room-furnishings.yaml")
    return keys.path.parent / value


def _materials(keys: _Keys) -> dict[tuple[int, int, int], str]:
    expected = "colours and radio materials, for example {'#0000ff': glazing, '#008000': door}"
    stated = keys.keys.get("materials", {})
    if not isinstance(stated, dict) or len(stated) > 250:
        raise keys.fail("materials", expected)
    materials = {}
    for colour, material in stated.items():
        if not (isinstance(colour, str) and re.fullmatch("#[0-9a-fA-F]{6}", colour)):
            raise keys.fail("materials", f"{expected}; {str(colour)[:80]!r} is no colour")
        try:
            material = MATERIAL.name_in_data("it", material, keys.path.parent)
        except ValueError as error:
            raise keys.fail("materials", f"a radio material for {colour}: {error}") from error
        red, green, blue = bytes.fromhex(colour[1:])
        materials[red, green, blue] = material
    return materials


def _thresholds(keys: _Keys) -> Thresholds:
    expected = "a probability between 0 and 1"
    free = keys.number("free_thresh", f"{Thresholds().free}", expected)
    occupied = keys.number("occupied_thresh", f"{Thresholds().occupied}", expected)
    for key, value in (("free_thresh", free), ("occupied_thresh", occupied)):
        if not 0 <= value <= 1:
            raise keys.fail(key, expected)
    if free > occupied:
        raise keys.fail(
            "free_thresh", f"at most occupied_thresh, which is {occupied:g}. Are the two swapped?"
        )
    return Thresholds(free, occupied)


def _origin(keys: _Keys) -> tuple[float, float, float]:
    value = keys.get("origin", "[0.0, 0.0, 0.0]")
    numbers = [_number(item) for item in value] if isinstance(value, list) else []
    finite = [number for number in numbers if number is not None]
    if len(finite) != len(numbers) or len(finite) not in (2, 3):
        raise keys.fail(
            "origin", "[x in metres, y in metres, yaw in radians], for example [-10.0, -5.0, 0.0]"
        )
    x, y, yaw = [*finite, 0.0][:3]
    if max(abs(x), abs(y)) > FARTHEST_M or abs(yaw) > MOST_YAW:
        raise keys.fail("origin", f"x and y within {FARTHEST_M:g} m and a yaw within {MOST_YAW:g} rad")
    if abs(yaw) > 2 * math.pi:
        logger.warning(
            f"{keys.path}: the yaw in origin is {yaw:g}, more than a full turn. It is in radians; was it meant in "
            "degrees?"
        )
    return x, y, yaw


def _image_path(keys: _Keys) -> Path:
    value = keys.get("image", f"{keys.path.stem}.pgm")
    if not isinstance(value, str) or not value.strip() or "\0" in value:
        raise keys.fail("image", f"the name of an image file, for example {keys.path.stem}.pgm")
    path = keys.path.parent / value
    try:
        if path.exists():
            return path
        same_name = keys.path.parent / Path(value).name
        names = [p.name for p in keys.path.parent.iterdir()]
        hint = (
            f"Did you mean '{same_name.name}', which is in the folder of the YAML file?"
            if same_name.is_file()
            else None
        )
    except OSError:
        hint, names = None, []
    near = get_close_matches(Path(value).name, names, 1)
    hint = hint or (
        f"Did you mean '{near[0]}'?" if near else "A relative path counts from the YAML file's folder."
    )
    raise MapError(f"{keys.path}: image is {value[:200]!r}, but there is no file {str(path)[:300]!r}. {hint}")
