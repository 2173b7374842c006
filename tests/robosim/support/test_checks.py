"""Configurations are checked against what their fields declare."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import pytest

from robosim.support.checks import Range, check_number, checked


class _Registry:
    def check(self, name: str, value: Any) -> None:
        if value != "known":
            raise ValueError(f"{name} is {value!r}. Known: known.")


@dataclass(frozen=True, kw_only=True)
@checked
class _Camera:
    width: Annotated[int, Range(8, 4096, "pixels", "Try 128.")] = 128
    far_m: Annotated[float | None, Range(0.1, 50, "m")] = None
    sizes: Annotated[tuple[int, ...], Range(1, 9)] = (1, 2)
    window_m: Annotated[tuple[float, float], Range(0, 9, "m")] = (1.0, 2.0)
    engine: Literal["fast", "exact"] = "fast"
    senses: tuple[Literal["rgb", "depth"], ...] = ("rgb",)
    part: Annotated[Any, _Registry()] = "known"
    near_m: float = 0.0

    def __post_init__(self) -> None:
        if self.far_m is not None and self.near_m > self.far_m:
            raise ValueError(f"near_m is {self.near_m}, expected at most far_m = {self.far_m} m.")


@dataclass(frozen=True, kw_only=True)
@checked
class _Wide(_Camera):
    angle: Annotated[float, Range(0, 180)] = 90


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"width": 0}, "width is 0, expected a whole number from 8 to 4096 pixels. Try 128."),
        ({"width": 10.0}, "width is 10.0, expected a whole number from 8 to 4096 pixels. Try 128."),
        ({"width": True}, "width is True, expected a whole number from 8 to 4096 pixels. Try 128."),
        ({"width": "9"}, "width is '9', expected a whole number from 8 to 4096 pixels. Try 128."),
        ({"far_m": float("nan")}, "far_m is nan, expected 0.1 to 50 m."),
        ({"sizes": (1, 10)}, "sizes is 10, expected a whole number from 1 to 9."),
        ({"sizes": 3}, "sizes is 3, expected several values."),
        ({"window_m": (1.0,)}, "window_m is (1.0,), expected 2 values."),
        ({"window_m": (1.0, -1.0)}, "window_m is -1.0, expected 0 to 9 m."),
        ({"engine": "fest"}, "engine is 'fest'. Did you mean 'fast'? Known: fast, exact."),
        ({"senses": ("rgb", "lidar")}, "senses is 'lidar'. Known: rgb, depth."),
        ({"part": "other"}, "part is 'other'. Known: known."),
        ({"far_m": 1.0, "near_m": 2.0}, "near_m is 2.0, expected at most far_m = 1.0 m."),
    ],
)
def test_message_of_wrong_values(values: dict[str, Any], message: str) -> None:
    """One line: the name, what was given, what was expected; then the checks of several fields together."""
    for kind in (_Camera, _Wide):
        with pytest.raises(ValueError, match="is") as error:
            kind(**values)
        assert str(error.value) == message


def test_subclasses_check_their_own_fields() -> None:
    with pytest.raises(ValueError, match="angle is 181, expected 0 to 180"):
        _Wide(angle=181)


def test_bounds_count_in() -> None:
    for value in (0, 2.5, 9):
        check_number("x", value, 0, 9)
    assert _Camera(width=8, far_m=50, sizes=(1, 9)).width == 8
