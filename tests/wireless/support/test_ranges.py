"""Configurations are checked against what their fields declare."""

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import pytest

from wireless.support.ranges import Range, checked


@dataclass(frozen=True, kw_only=True)
@checked
class _Receiver:
    height_m: Annotated[float, Range(0, 100, "m", "Heights count from the floor.")] = 1.5
    rays: Annotated[int | None, Range(1, 9, "rays")] = None
    law: Literal["bisector", "nearer_face"] = "bisector"
    name: str = "free"

    def __post_init__(self) -> None:
        if self.law == "nearer_face" and self.rays is None:
            raise ValueError("rays is None, but the law needs some.")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"height_m": -1}, "height_m is -1, expected 0 to 100 m. Heights count from the floor."),
        ({"height_m": float("nan")}, "height_m is nan, expected 0 to 100 m. Heights count from the floor."),
        ({"rays": 0}, "rays is 0, expected a whole number from 1 to 9 rays, or None."),
        ({"rays": 1.5}, "rays is 1.5, expected a whole number from 1 to 9 rays, or None."),
        ({"rays": True}, "rays is True, expected a whole number from 1 to 9 rays, or None."),
        ({"law": "face"}, "law is 'face', expected one of bisector, nearer_face."),
        ({"law": "nearer_face"}, "rays is None, but the law needs some."),
    ],
)
def test_message_of_wrong_values(values: dict[str, Any], message: str) -> None:
    """One line: the name, what was given, what was expected; then the checks of several fields together."""
    with pytest.raises(ValueError, match="is") as error:
        _Receiver(**values)
    assert str(error.value) == message


def test_bounds_count_in_and_copies_are_checked() -> None:
    receiver = _Receiver(height_m=100, rays=9, law="nearer_face")
    with pytest.raises(ValueError, match="rays is 10"):
        replace(receiver, rays=10)
