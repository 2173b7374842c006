"""Driven wheels of a description: round bodies that turn without limit around y, in pairs at one level.

What hangs lower than the wheels, such as an arm, is none of them: of all levels, the lowest with a pair is the floor.
Wheels on a swivel with a trail, of any size, are casters. Wheels that a hinge around z steers (Ackermann, swerve
drives), and wheels with rollers (mecanum, omnidirectional), are errors, as they make another drive.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from robosim.robot.physics_engine import mujoco

#: How far wheels may be from the floor, and from each other in size and place [m].
LEVEL_M = 0.01
#: Least over greatest reach of a wheel from its axle, and trail of a caster [m].
_ROUND, _TRAIL_M = 0.75, 0.005
#: Fewest hinges on a wheel that are rollers.
_ROLLERS = 3


class Wheel(NamedTuple):
    """A driven wheel."""

    joint: str
    link: str
    place: Float[np.ndarray, "3"]
    """Its centre in the frame of the description [m]."""
    radius_m: float
    turns: float
    """1 if positive turns of the joint roll it ahead, else -1."""
    tyre_m: float
    """How far the middle of its tyre is from the joint's place along the joint's axis [m]."""


#: Wheels on the left and on the right, from behind to ahead.
Sides = tuple[list[Wheel], list[Wheel]]


def find_wheels(
    model: mujoco.MjModel, data: mujoco.MjData, points: dict[int, Float[np.ndarray, "_ 3"]]
) -> Sides:
    """The driven wheels on the left and on the right.

    Args:
        model: The description.
        data: Its state, at rest.
        points: Points of each geom that collides [m].

    Raises:
        ValueError: If there are none in pairs, or they make no differential drive.
    """
    hinges = _round_hinges(model, data, points)
    bottoms = [wheel.place[2] - wheel.radius_m for wheel in hinges]
    problem: ValueError | None = None
    for bottom in sorted(set(bottoms)):
        at_level = [
            wheel for wheel, other in zip(hinges, bottoms, strict=True) if 0 <= other - bottom < LEVEL_M
        ]
        steering = _steering(model, data, at_level)
        driven = [wheel for wheel in at_level if wheel.joint not in steering or not steering[wheel.joint][1]]
        try:
            sides = _paired(driven)
        except ValueError as error:
            problem = problem or error
            continue
        steered = {wheel: hinge for wheel, (hinge, is_caster) in steering.items() if not is_caster}
        for wheel, hinge in (steered | _knuckles(model, data, points, bottom)).items():
            raise ValueError(f"wheel {wheel} is steered by hinge {hinge}, expected a differential drive")
        _check_rollers(model, sides)
        return sides
    raise problem or _no_pairs(hinges)


def face_ahead(model: mujoco.MjModel, data: mujoco.MjData) -> list[str]:
    """Undo the yaw of robots that stand turned in the world; returns a note of each.

    The pose of a body of MJCF in the world is where it starts, so ahead is its own x, not the world's, unless more
    hinges turn around the world's y than around its own.
    """
    notes = []
    for k in np.flatnonzero(model.body_parentid[1:] == 0) + 1:
        turn = data.xmat[k].reshape(3, 3)
        yaw_rad = math.atan2(turn[1, 0], turn[0, 0])
        free = [j for j in range(model.njnt) if _is_hinge(model, j) and not _is_limited(model, j)]
        axes = data.xaxis[[j for j in free if model.body_rootid[model.jnt_bodyid[j]] == k]]
        around_own, around_y = (np.abs(axes @ np.column_stack([turn[:, 1], [0.0, 1.0, 0.0]])) > 0.99).sum(
            axis=0
        )
        if abs(yaw_rad) < 1e-6 or turn[2, 2] < 0.99 or around_own < max(1, around_y):
            continue
        quat = np.empty(4)
        mujoco.mju_mulQuat(quat, [math.cos(yaw_rad / 2), 0.0, 0.0, -math.sin(yaw_rad / 2)], data.xquat[k])
        model.body_quat[k] = quat
        first = model.body_jntadr[k]
        if first >= 0 and model.jnt_type[first] == mujoco.mjtJoint.mjJNT_FREE:
            data.qpos[model.jnt_qposadr[first] :][3:7] = quat
        notes.append(
            f"{model.body(k).name} stands turned by {math.degrees(yaw_rad):.3g} degrees: ahead is x of its own frame"
        )
    mujoco.mj_fwdPosition(model, data)
    return notes


def _round_hinges(
    model: mujoco.MjModel, data: mujoco.MjData, points: dict[int, Float[np.ndarray, "_ 3"]]
) -> list[Wheel]:
    """Hinges around y without limits whose bodies are round around them."""
    angle = np.linspace(0, 2 * math.pi, 64, endpoint=False)
    hinges = []
    for k in range(model.njnt):
        axis, place = data.xaxis[k], data.xanchor[k]
        if not _is_hinge(model, k) or abs(axis[1]) < 0.99 or _is_limited(model, k):
            continue
        body = model.jnt_bodyid[k]
        of_body = [points[g] for g in points if model.body_weldid[model.geom_bodyid[g]] == body]
        if not of_body:
            continue
        rim = np.vstack(of_body)[:, [0, 2]] - place[[0, 2]]
        reach_m = (rim @ [np.cos(angle), np.sin(angle)]).max(axis=0)
        if reach_m.min() > _ROUND * reach_m.max():
            radius_m = float(np.hypot(*rim.T).max())
            along_m = ((np.vstack(of_body) - place) @ axis)[np.hypot(*rim.T) > 0.9 * radius_m]
            tyre_m = float(along_m.min() + along_m.max()) / 2
            names, turns = (model.joint(k).name, model.body(body).name), float(np.sign(axis[1]))
            hinges.append(Wheel(*names, place + tyre_m * axis, radius_m, turns, tyre_m))
    return hinges


def _is_hinge(model: mujoco.MjModel, k: int) -> bool:
    return bool(model.jnt_type[k] == mujoco.mjtJoint.mjJNT_HINGE)


def _is_limited(model: mujoco.MjModel, k: int) -> bool:
    """Whether a hinge cannot turn once around; limits that are equal are none."""
    span = float(np.ptp(model.jnt_range[k]))
    return bool(model.jnt_limited[k]) and 0 < span < 2 * math.pi - 0.01


def _body(model: mujoco.MjModel, wheel: Wheel) -> int:
    return int(model.joint(wheel.joint).bodyid[0])


def _is_below(model: mujoco.MjModel, body: int, ancestor: int) -> bool:
    """Whether a body hangs on another one, or is it."""
    while body > ancestor:
        body = int(model.body_parentid[body])
    return body == ancestor


def _upright_hinges(model: mujoco.MjModel, data: mujoco.MjData) -> list[int]:
    return [k for k in range(model.njnt) if _is_hinge(model, k) and abs(data.xaxis[k][2]) > 0.7]


def _steering(model: mujoco.MjModel, data: mujoco.MjData, wheels: list[Wheel]) -> dict[str, tuple[str, bool]]:
    """Find the hinges around z that turn single wheels, by wheel, and whether they make it a caster."""
    steering = {}
    for k in _upright_hinges(model, data):
        below = [wheel for wheel in wheels if _is_below(model, _body(model, wheel), int(model.jnt_bodyid[k]))]
        if len(below) == len(wheels) > 1:
            continue
        for wheel in below:
            trail_m = abs(wheel.place[0] - data.xanchor[k][0])
            is_caster = not _is_limited(model, k) and trail_m > _TRAIL_M
            steering[wheel.joint] = (model.joint(k).name, bool(is_caster))
    return steering


def _knuckles(
    model: mujoco.MjModel, data: mujoco.MjData, points: dict[int, Float[np.ndarray, "_ 3"]], floor_m: float
) -> dict[str, str]:
    """Round bodies on the floor that a hinge of limited range turns around z, and the hinge."""
    knuckles = {}
    for k in _upright_hinges(model, data):
        body = model.jnt_bodyid[k]
        of_body = [points[g] for g in points if model.body_weldid[model.geom_bodyid[g]] == body]
        if of_body and _is_limited(model, k):
            low, high = np.vstack(of_body).min(axis=0), np.vstack(of_body).max(axis=0)
            size = high - low
            if abs(size[0] - size[2]) < 0.1 * size[2] and abs(low[2] - floor_m) < LEVEL_M:
                knuckles[model.body(body).name] = model.joint(k).name
    return knuckles


def _check_rollers(model: mujoco.MjModel, sides: Sides) -> None:
    """Raise ValueError for wheels with rollers."""
    for wheel in (*sides[0], *sides[1]):
        body = _body(model, wheel)
        hinges = [k for k in range(model.njnt) if _is_below(model, int(model.jnt_bodyid[k]), body)]
        if len(hinges) > _ROLLERS:
            raise ValueError(
                f"wheel {wheel.joint} has {len(hinges) - 1} rollers, expected a differential drive"
            )


def _paired(hinges: list[Wheel]) -> Sides:
    """The largest wheels, as many on the left as on the right."""
    largest_m = max((wheel.radius_m for wheel in hinges), default=0.0)
    wheels = [wheel for wheel in hinges if wheel.radius_m > largest_m - LEVEL_M]
    middle = np.mean([wheel.place[1] for wheel in wheels]) if wheels else 0.0
    left, right = (
        sorted(
            (wheel for wheel in wheels if side * (wheel.place[1] - middle) > 0),
            key=lambda wheel: wheel.place[0],
        )
        for side in (1, -1)
    )
    pairs = zip(left, right, strict=False)
    if not left or len(left) != len(right) or any(abs(a.place[0] - b.place[0]) > LEVEL_M for a, b in pairs):
        raise _no_pairs(hinges)
    return left, right


def _no_pairs(hinges: list[Wheel]) -> ValueError:
    names = ", ".join(f"{wheel.joint} at y = {wheel.place[1]:g} m" for wheel in hinges) or "none"
    return ValueError(
        f"its round wheels that turn around y on the floor are {names}, expected as many on the left as on the right, "
        "in pairs: x ahead, y to the left"
    )
