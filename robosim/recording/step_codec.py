"""A step as a row of small arrays, for files, pipes between processes and memory.

Pictures are PNG: that of the camera, its depth in millimetres, the rectangle of the map that changed, and the belief in
64 levels. A video is drawn from the same rounded values, so that a replay is the same video.
"""

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8, UInt16

from robosim.layers import Layer, LevelledBelief, depth_in_mm, map_of_layer
from robosim.policies.estimates import Estimates
from robosim.policies.reason import GoalKind, Reason
from robosim.radio.measurement import Measurement
from robosim.simulator import Observation
from robosim.step import Decision, Step, Truth
from robosim.support.arrays_in import opened_image
from slam.actions import Action, Command, Velocity, nearest_action
from slam.grid import GridFrame
from slam.sensing.laser import LaserScan
from wireless.paths import LinkState

#: Columns of fixed length, with the shape of an entry.
FIXED: dict[str, tuple[int, ...]] = {
    "pose": (3,), "estimate": (3,), "coverage": (), "map_frame": (5,), "map_corner": (2,), "odometry": (3,),
    "action": (), "goal": (2,), "mass": (), "true_state": (), "true_aoa_rad": (), "state_probability": (4,),
    "belief_frame": (5,),
}  # fmt: skip
#: Columns of text.
TEXTS = ("goal_kind", "because")
#: Columns of entries of any length, with the shape of an empty one.
RAGGED: dict[str, tuple[int, ...]] = {
    "map": (0,), "path": (0, 2), "arrival": (0, 5), "rgb": (0,), "depth": (0,), "belief": (0,), "bodies": (0, 4),
    "laser": (0, 2), "laser_limits": (0, 3), "velocity": (0, 3),
}  # fmt: skip
#: Fields that a file lacks where they are empty in all steps.
OPTIONAL = ("bodies", "laser", "laser_limits", "velocity")
#: Link state without a radio.
NO_RADIO = -1
NO_FRAME: Float[np.ndarray, "5"] = np.full(5, np.nan)
NO_BODIES: Float[np.ndarray, "0 4"] = np.zeros((0, 4))
NO_VELOCITY: Float[np.ndarray, "0 3"] = np.zeros((0, 3))
NO_SCAN: Float[np.ndarray, "0 2"] = np.zeros((0, 2))
NO_LIMITS: Float[np.ndarray, "0 3"] = np.zeros((0, 3))
NO_BYTES: UInt8[np.ndarray, "0"] = np.zeros(0, np.uint8)
_MOST_PIXELS = 4096**2

Row = Mapping[str, Any]


def encode_step(step: Step, previous: Layer | None = None) -> dict[str, Any]:
    """All columns of a step, with the map relative to the previous one, or whole without one."""
    belief, sensed = step.belief_layer, step.sensed
    return encode_without_pictures(step) | {
        **encode_map(step.map_layer, previous),
        "arrival": _arrivals(step),
        "rgb": _png(np.ascontiguousarray(sensed.rgb[..., ::-1])),
        "depth": _png(depth_in_mm(sensed.depth)),
        "belief": NO_BYTES if belief is None else _png(belief.values),
        "belief_frame": NO_FRAME if belief is None else _numbers_of(belief.frame),
        **_laser_columns(sensed.laser),
    }


def encode_without_pictures(step: Step) -> dict[str, Any]:
    """The columns of a step without camera, lidar, map and belief, and with the strongest estimated path only."""
    measured, decided, true = step.estimated.measurement, step.decided, step.true
    return {
        "pose": np.array(true.pose),
        "estimate": np.array(step.estimated.pose),
        "coverage": true.coverage,
        "map": NO_BYTES,
        "map_frame": NO_FRAME,
        "map_corner": np.zeros(2),
        "odometry": np.array(step.sensed.odometry),
        "action": int(nearest_action(decided.command)),
        "velocity": np.array([decided.command]) if isinstance(decided.command, Velocity) else NO_VELOCITY,
        "goal": np.array(decided.goal, float),
        "goal_kind": decided.reason.kind.value,
        "because": decided.reason.because,
        "mass": decided.reason.mass,
        "path": np.array(decided.path, float).reshape(-1, 2),
        "true_state": NO_RADIO if true.link_state is None else int(true.link_state),
        "true_aoa_rad": true.aoa_rad,
        "state_probability": np.full(4, np.nan)
        if measured is None
        else np.array(measured.probability, float),
        "arrival": _arrivals(step)[:1],
        "bodies": true.bodies,
        "laser": NO_SCAN,
        "laser_limits": NO_LIMITS,
        "rgb": NO_BYTES,
        "depth": NO_BYTES,
        "belief": NO_BYTES,
        "belief_frame": NO_FRAME,
    }


def _arrivals(step: Step) -> Float[np.ndarray, "n 5"]:
    """Estimated paths: azimuths of arrival and departure [rad], SNR, gain [dB] and delay [s]."""
    m = step.estimated.measurement
    if m is None:
        return np.zeros((0, 5))
    return np.column_stack([m.aoa_rad, m.aod_rad, m.snr_db, m.gain_db, m.delay_s]).astype(float)


def _laser_columns(laser: LaserScan | None) -> dict[str, Any]:
    """Bearings [rad] and ranges [m], 0 for none; the largest range, the height, and how far it is ahead [m]."""
    if laser is None:
        return {"laser": NO_SCAN, "laser_limits": NO_LIMITS}
    ranges = np.where(laser.hit, laser.range_m, 0.0)
    limits = np.array([[laser.max_range_m, laser.height_m, laser.ahead_m]])
    return {"laser": np.column_stack([laser.bearing_rad, ranges]), "laser_limits": limits}


def _decode_laser(row: Row) -> LaserScan | None:
    """The scan of a row; None without one."""
    scan, limits = row.get("laser", NO_SCAN), row.get("laser_limits", NO_LIMITS)
    if len(scan) < 2 or len(limits) != 1:
        return None
    bearing, ranges = scan.T
    return LaserScan(
        bearing_rad=bearing,
        range_m=np.where(ranges > 0, ranges, np.inf),
        max_range_m=float(limits[0, 0]),
        height_m=float(limits[0, 1]),
        ahead_m=float(limits[0, 2]),
    )


def decode_step(number: int, row: Row, map_: Layer, belief: Layer | None) -> Step:
    """The step of a row, with its map and belief by `decode_map` and `decode_belief`.

    Raises:
        ValueError: If a picture is damaged.
    """
    rgb, depth_mm = decode_camera(row)
    measurement, pose = None, np.array(row["estimate"])
    if not np.isnan(row["state_probability"]).any():
        aoa, aod, snr, gain, delay = row["arrival"].T
        measurement = Measurement(pose, aoa, aod, snr, gain, delay, row["state_probability"])
    return Step(
        number=number,
        sensed=Observation(
            rgb, depth_mm / np.float32(1000), np.array(row["odometry"]), laser=_decode_laser(row)
        ),
        decided=Decision(
            goal=np.array(row["goal"]),
            reason=Reason(GoalKind(str(row["goal_kind"])), str(row["because"]), float(row["mass"])),
            path=row["path"],
            command=_decode_command(row),
            estimates=Estimates(map_of_layer(map_, pose), measurement),
            belief=None if belief is None else LevelledBelief(belief),
        ),
        true=Truth(
            pose=np.array(row["pose"]),
            coverage=float(row["coverage"]),
            link_state=None if row["true_state"] == NO_RADIO else LinkState(int(row["true_state"])),
            aoa_rad=float(row["true_aoa_rad"]),
            paths=row.get("paths"),
            bodies=row.get("bodies", NO_BODIES),
        ),
    )


def _decode_command(row: Row) -> Command:
    """The velocity of a row, or else its action."""
    for velocity in row.get("velocity", NO_VELOCITY):
        return Velocity(*velocity.tolist())
    return Action(int(row["action"]))


def decode_camera(row: Row) -> tuple[UInt8[np.ndarray, "h w 3"], UInt16[np.ndarray, "h w"]]:
    """Picture and depth [mm] of the camera; without pixels if they are not recorded.

    Raises:
        ValueError: If one is damaged.
    """
    if not len(row["rgb"]):
        return np.zeros((0, 0, 3), np.uint8), np.zeros((0, 0), np.uint16)
    rgb, depth_mm = _image(row["rgb"], "RGB"), _image(row["depth"], "I;16")
    if rgb.shape[:2] != depth_mm.shape:
        raise ValueError("a picture and its depth are of different sizes")
    return rgb, depth_mm


def encode_map(layer: Layer, previous: Layer | None) -> dict[str, Any]:
    """The smallest rectangle of a map that holds all changes since another, as columns; no bytes for no change."""
    changed = layer.values != _on_frame(previous, layer.frame)
    rows, columns = (np.flatnonzero(changed.any(axis)) for axis in (1, 0))
    picture, corner = NO_BYTES, np.zeros(2)
    if len(rows):
        cells = layer.values[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        picture, corner = _png(np.ascontiguousarray(cells), flat=True), np.array([rows[0], columns[0]], float)
    return {"map": picture, "map_frame": _numbers_of(layer.frame), "map_corner": corner}


def decode_map(row: Row, previous: Layer | None) -> Layer | None:
    """The map of a row, or the previous one if the row has none.

    Raises:
        ValueError: If its picture is damaged, or lies outside of the map.
    """
    if np.isnan(row["map_frame"]).all():
        return previous
    frame = _frame_of(row["map_frame"])
    values = _on_frame(previous, frame)
    if len(row["map"]):
        picture, (top, left) = _image(row["map"], "L"), row["map_corner"].astype(int)
        window = values[top : top + picture.shape[0], left : left + picture.shape[1]]
        if min(top, left) < 0 or window.shape != picture.shape:
            raise ValueError("a part of the map lies outside of the map")
        window[:] = picture
    return Layer(frame, values)


def decode_belief(row: Row, previous: Layer | None) -> Layer | None:
    """The belief of a row, or the previous one if the row has only its frame.

    Raises:
        ValueError: If its picture is damaged, or does not fit its frame.
    """
    if np.isnan(row["belief_frame"]).all():
        return None
    if not len(row["belief"]):
        return previous
    belief = Layer(_frame_of(row["belief_frame"]), _image(row["belief"], "L"))
    if belief.values.shape != belief.frame.shape:
        raise ValueError("a belief is no picture of its frame")
    return belief


def _numbers_of(frame: GridFrame) -> Float[np.ndarray, "5"]:
    return np.array([*frame.origin_xy, frame.resolution_m, *frame.shape])


def _frame_of(numbers: Float[np.ndarray, "5"]) -> GridFrame:
    x, y, cell_m, rows, columns = numbers.tolist()
    return GridFrame(origin_xy=(x, y), resolution_m=cell_m, shape=(int(rows), int(columns)))


def _on_frame(layer: Layer | None, frame: GridFrame) -> UInt8[np.ndarray, "ny nx"]:
    """Values of a layer on another frame; 0 beyond the layer, or if the cells have another size."""
    values = np.zeros(frame.shape, np.uint8)
    if layer is not None and layer.frame.resolution_m == frame.resolution_m:
        corner = np.subtract(layer.frame.origin_xy, frame.origin_xy) / frame.resolution_m
        first = np.rint(corner[::-1]).astype(int)
        low, high = np.maximum(first, 0), np.minimum(first + layer.values.shape, frame.shape)
        if (low < high).all():
            window = layer.values[
                low[0] - first[0] : high[0] - first[0], low[1] - first[1] : high[1] - first[1]
            ]
            values[low[0] : high[0], low[1] : high[1]] = window
    return values


def _png(image: np.ndarray, *, flat: bool = False) -> UInt8[np.ndarray, " n"]:
    """A picture as PNG; large areas of one value, as in maps, are packed three times as fast by run lengths."""
    runs = [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
    _, content = cv2.imencode(".png", image, runs if flat else [cv2.IMWRITE_PNG_COMPRESSION, 4])
    return np.asarray(content, np.uint8).ravel()


def _image(data: UInt8[np.ndarray, " n"], mode: str) -> np.ndarray:
    with opened_image(data.tobytes(), _MOST_PIXELS, ("PNG",)) as image:
        if image.mode != mode:
            raise ValueError(f"a picture has pixels of kind {image.mode}, expected {mode}")
        return np.asarray(image)
