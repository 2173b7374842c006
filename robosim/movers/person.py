"""The surface of a walking person, for cameras and lidars: limbs between joints that swing with the distance walked.

Limbs are six-sided frustums with level ends, 300 triangles in all. Lengths are shares of the height by R. Drillis and
R. Contini, Body segment parameters, New York University report 1166.03 (1966), figure 4; legs and arms swing like
sines, in the range of a normal gait (M. W. Whittle, Gait analysis, 2007, chapter 2). Left out: faces, fingers, and
turns of trunk and hip.
"""

import math
from functools import lru_cache

import numpy as np
from jaxtyping import Float, UInt8

#: Heights of joints over the height of the person: ankle, knee, hip, waist, shoulder, chin, crown.
_ANKLE, _KNEE, _HIP, _WAIST, _SHOULDER, _CHIN, _CROWN = 0.039, 0.285, 0.530, 0.60, 0.818, 0.870, 1.0
#: Half widths over the height: hip joints, shoulders; lengths of upper arm, forearm with hand, and foot.
_HIP_Y, _SHOULDER_Y, _UPPER_ARM, _FOREARM, _FOOT = 0.055, 0.125, 0.186, 0.20, 0.13
#: Length of two steps over the height, and largest angles at a speed of 1.3 m/s [rad].
_STRIDE, _SWING, _KNEE_BEND, _ARM_SWING, _ELBOW = (
    0.83,
    math.radians(25),
    math.radians(45),
    math.radians(20),
    0.35,
)
_USUAL_MPS = 1.3
#: Sides of a limb, and phases of the gait.
_SIDES, _PHASES = 6, 32
#: Colours that clothes, hair and skin are drawn from.
_SHIRTS = np.array(
    [(178, 60, 52), (56, 96, 160), (70, 130, 90), (206, 176, 82), (120, 84, 140), (210, 210, 205)]
)
_TROUSERS = np.array([(52, 58, 74), (88, 78, 66), (38, 38, 42), (96, 108, 122)])
_HAIR = np.array([(48, 36, 30), (94, 66, 44), (150, 122, 82), (120, 118, 116)])
_SKIN = np.array([(228, 190, 160), (196, 146, 112), (140, 96, 70), (96, 66, 50)])


def stride_m(height_m: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Distance of two steps [m], by the height of a person."""
    return _STRIDE * height_m


def person_triangles(height_m: float, phase: float, speed_mps: float) -> Float[np.ndarray, "n 3 3"]:
    """Triangles of a person at the origin who faces +x [m]; in 32 phases (2 pi are two steps) and four speeds."""
    step = round(phase / (2 * math.pi) * _PHASES) % _PHASES
    return height_m * _person(step, min(round(4 * speed_mps / _USUAL_MPS), 4))


@lru_cache(4 * _PHASES + 1)
def _person(step: int, quarters: int) -> Float[np.ndarray, "n 3 3"]:
    """Triangles of a person of height 1 in one of the phases, at a speed in quarters of the usual one."""
    share, phase = quarters / 4, 2 * math.pi * step / _PHASES
    limbs = []
    for side, at in ((1, phase), (-1, phase + math.pi)):
        hip = np.array([0.0, side * _HIP_Y, _HIP])
        swing = share * _SWING * math.sin(at)
        bend = share * _KNEE_BEND * max(math.sin(at - 0.5 * math.pi), 0.0) ** 2
        knee = hip + (_HIP - _KNEE) * _down(swing)
        ankle = knee + (_KNEE - _ANKLE) * _down(swing - bend)
        sole = np.array([ankle[0] + 0.25 * _FOOT, ankle[1], ankle[2] - _ANKLE])
        limbs += [(hip, knee, (0.05, 0.05), (0.034, 0.034)), (knee, ankle, (0.034, 0.034), (0.024, 0.024))]
        limbs += [(ankle, sole, (0.026, 0.024), (0.5 * _FOOT, 0.028))]
        shoulder = np.array([0.0, side * _SHOULDER_Y, _SHOULDER - 0.01])
        swing = -share * _ARM_SWING * math.sin(at)
        elbow = shoulder + _UPPER_ARM * _down(swing)
        hand = elbow + _FOREARM * _down(swing + _ELBOW * (0.3 + share))
        limbs += [
            (shoulder, elbow, (0.028, 0.028), (0.022, 0.022)),
            (elbow, hand, (0.022, 0.022), (0.018, 0.02)),
        ]
    middle = np.array([0.0, 0.0, 1.0])
    limbs += [
        (_HIP * middle - (0, 0, 0.03), _WAIST * middle, (0.06, 0.095), (0.055, 0.08)),
        (_WAIST * middle, (_SHOULDER + 0.01) * middle, (0.055, 0.08), (0.058, 0.115)),
        (_SHOULDER * middle, _CHIN * middle, (0.03, 0.03), (0.03, 0.03)),
        (_CHIN * middle, 0.955 * middle, (0.036, 0.034), (0.056, 0.046)),
        (0.955 * middle, _CROWN * middle, (0.056, 0.046), (0.028, 0.024)),
    ]
    return np.concatenate([_frustum(*limb) for limb in limbs])


def person_colours(rng: np.random.Generator) -> UInt8[np.ndarray, "n 3"]:
    """A colour for each of the triangles of a person."""
    shirt, trousers, hair, skin = (
        palette[rng.integers(len(palette))] for palette in (_SHIRTS, _TROUSERS, _HAIR, _SKIN)
    )
    shoe = trousers // 2
    parts = 2 * [trousers, trousers, shoe, shirt, skin] + [trousers, shirt, skin, skin, hair]
    sides = 0.85 + 0.15 * np.cos(2 * math.pi * (np.arange(_SIDES) + 0.5) / _SIDES)
    shade = np.concatenate([sides, sides, np.ones(2 * (_SIDES - 2))])
    return np.concatenate([np.outer(shade, colour) for colour in parts]).astype(np.uint8)


@lru_cache(64)
def cylinder_triangles(radius_m: float, height_m: float) -> Float[np.ndarray, "n 3 3"]:
    """Triangles of an upright cylinder of twelve sides on the floor at the origin [m]."""
    return _frustum(np.zeros(3), np.array([0.0, 0.0, height_m]), (radius_m,) * 2, (radius_m,) * 2, 2 * _SIDES)


def _down(angle: float) -> Float[np.ndarray, "3"]:
    """A unit vector downwards, swung ahead by an angle [rad]."""
    return np.array([math.sin(angle), 0.0, -math.cos(angle)])


def _frustum(
    start: np.ndarray,
    end: np.ndarray,
    start_half: tuple[float, float],
    end_half: tuple[float, float],
    sides: int = _SIDES,
) -> Float[np.ndarray, "n 3 3"]:
    """A limb from a point to another with level elliptic ends of these half axes along x and y."""
    angle = 2 * math.pi * np.arange(sides) / sides
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(sides)])
    a, b = start + ring * (*start_half, 0), end + ring * (*end_half, 0)
    a_next, b_next = np.roll(a, -1, axis=0), np.roll(b, -1, axis=0)
    walls = np.concatenate([np.stack([a, a_next, b_next], 1), np.stack([a, b_next, b], 1)])
    fan = [(0, k, k + 1) for k in range(1, sides - 1)]
    return np.concatenate([walls, a[fan][:, ::-1], b[fan]])
