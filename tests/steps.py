"""Steps of episodes that were never run."""

import numpy as np

from robosim.layers import LevelledBelief, map_of_layer
from robosim.policies.estimates import Estimates
from robosim.policies.reason import EXPLORE
from robosim.radio.measurement import Measurement
from robosim.recording.episode_file import EpisodeWriter, Head, read_episode
from robosim.simulator import Observation
from robosim.step import Decision, Step, Truth
from slam.actions import Action
from slam.grid import GridFrame, MapEstimate
from wireless.paths import LinkState

HALL = np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 4.0], [0.0, 4.0]])


def measurement(pose, state: LinkState, aoa_rad=(), snr_db=()) -> Measurement:
    """A link in one state for sure, with these paths."""
    nothing = np.zeros(len(aoa_rad))
    angles, snrs = np.array(aoa_rad, float), np.array(snr_db, float)
    return Measurement(
        np.array(pose, float), angles, nothing, snrs, nothing, nothing, np.eye(len(LinkState))[state]
    )


def unknown_map(pose) -> MapEstimate:
    """A map of 3 m by 6 m on which nothing is known."""
    frame = GridFrame(origin_xy=(0.0, 0.0), shape=(60, 120))
    nothing = np.zeros(frame.shape, bool)
    odds = np.full(frame.shape, 0.5, np.float32)
    return MapEstimate(frame=frame, obstacle_probability=odds, explored=nothing, blocked=nothing, pose=pose)


def step(number=0, *, pose=(1.0, 0.6, 0.0), estimate=None, **groups) -> Step:
    """A step on an unknown map, towards a goal without a path.

    Args:
        number: Actions done before it.
        pose: True pose.
        estimate: Estimated pose; the true one if not given.
        groups: `map` (estimated map or layer), `measured`, `belief` (a layer), `rgb`, `depth`, `goal`, `path`,
            `reason`, `coverage`, `state` (true link state).
    """
    pose = np.array(pose, float)
    estimate = pose if estimate is None else np.array(estimate, float)
    map_, belief = groups.get("map"), groups.get("belief")
    if not isinstance(map_, MapEstimate):
        map_ = unknown_map(estimate) if map_ is None else map_of_layer(map_, estimate)
    return Step(
        number=number,
        sensed=Observation(
            groups.get("rgb", np.full((8, 8, 3), 90, np.uint8)),
            groups.get("depth", np.full((8, 8), 0.001, np.float32)),
            np.zeros(3),
        ),
        decided=Decision(
            goal=np.array(groups.get("goal", (2.0, 1.0)), float),
            reason=groups.get("reason", EXPLORE),
            path=np.array(groups.get("path", np.zeros((0, 2))), float).reshape(-1, 2),
            command=Action.FORWARD,
            estimates=Estimates(map_, groups.get("measured")),
            belief=None if belief is None else LevelledBelief(belief),
        ),
        true=Truth(pose=pose, coverage=groups.get("coverage", 0.25), link_state=groups.get("state")),
    )


def write_episode(
    path, row, poses, *, goals=None, state=None, estimated_state=None, snr_db=20.0, reasons=None, rings=None
):
    """Write an episode without pictures that goes through poses; returns it as read back.

    Args:
        path: The file.
        row: Its identity and scores.
        poses: True and estimated poses, one more than decisions.
        goals: Goal of each decision; the next position if not given.
        state: True link state; None without a radio.
        estimated_state: Estimated link state; the true one if not given.
        snr_db: SNR of the one path.
        reasons: Reason of each decision.
        rings: Outlines of the building; a hall of 8 m by 4 m if not given.
    """
    writer = EpisodeWriter([HALL] if rings is None else rings, pictures=False)
    for i, pose in enumerate(poses[:-1]):
        groups = {"state": state, "goal": poses[i + 1][:2] if goals is None else goals[i]}
        if state is not None:
            shown = state if estimated_state is None else estimated_state
            groups["measured"] = measurement(pose, shown, [0.1], [snr_db])
        if reasons is not None:
            groups["reason"] = reasons[i]
        writer.add(step(i, pose=pose, **groups))
    path.parent.mkdir(parents=True, exist_ok=True)
    head = Head(row=row, seeks_target=True, timing={"wall": 1.0})
    path.write_bytes(
        writer.content(head, poses[-1], 0.5, unknown_map(np.array(poses[-1])), np.arange(len(poses)) * 1.0)
    )
    return read_episode(path)
