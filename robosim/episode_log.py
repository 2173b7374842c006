"""Log of an episode: trajectories, links, and the scores computed from them.

Metrics go by their usual names: success weighted by path length (SPL) and its soft form (Anderson et al.
2018; Datta et al. 2020), coverage, and the distance between estimated and true position. Trajectories are
TUM files, `timestamp x y z qx qy qz qw` in seconds of simulated time, as evo reads them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float

from robosim.movers.movers import Contact
from robosim.radio.link import RadioLink
from robosim.radio.measurement import Measurement
from robosim.robot.motion import Motion
from robosim.support.axes import axes_in_metres
from robosim.support.colours import ESTIMATE, TARGET, TRUE
from robosim.support.tum import write_tum
from robosim.task.tasks import ARRIVAL_M, Task
from slam.graph.landmarks import Transmitter
from slam.poses import Pose, wrap
from wireless.paths import LinkState
from wireless.support.counting import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes


#: A line of sight with more loss than this by people counts as blocked [dB].
_BLOCKED_DB = 3.0


class Link(NamedTuple):
    """A measurement of the radio, for judging."""

    state: LinkState
    """True link state."""
    believed: LinkState
    """The most probable state, as estimated."""
    snr_db: float
    """SNR of the strongest estimated path; -inf if none was found."""
    sight_loss_db: float
    """Loss of the direct path by people [dB]; NaN without a direct path, or people."""
    aoa_error_rad: float
    """Between the strongest estimated and the strongest true path in `map`; NaN if either is missing."""


@dataclass(eq=False)
class EpisodeLog:
    """Poses, motions and links of an episode, one entry per step."""

    task: Task
    poses: list[np.ndarray] = field(default_factory=list)
    """True poses; the first is the start."""
    estimates: list[np.ndarray] = field(default_factory=list)
    """Estimated poses, at the same steps."""
    motions: list[Motion] = field(default_factory=list)
    """Motion that each action caused."""
    coverage: list[float] = field(default_factory=list)
    """Part of the reachable floor seen, at each pose."""
    links: list[Link] = field(default_factory=list)
    """Link to the target at each decision; empty without a radio."""
    anchor_links: dict[str, list[Link]] = field(default_factory=dict)
    """Measurements of other transmitters, by name."""
    transmitters: Mapping[str, Transmitter] = field(default_factory=dict)
    """Positions of transmitters as mapped in the end, by name: only transmitters measured in line of sight."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Wall-clock time by stage [s]."""
    contacts: list[Contact] | None = None
    """Contacts with people and others who move; None without them."""
    ended: str = "running"
    """Why the episode ended: arrived, another arrived, explored, out of steps, lost, interrupted, terminated."""
    seeks_target: bool = True
    """Whether the target is searched for; an episode of exploration is scored by its coverage."""
    robot: str = "robot"
    """Name of the robot."""

    def __repr__(self) -> str:
        return f"<EpisodeLog: {self.ended} after {counted(self.steps, 'step')}>"

    def add_pose(self, motion: Motion | None, pose: Pose, estimate: Pose, coverage: float) -> None:
        """Add a step: the motion that led to it, true and estimated pose, and the coverage so far."""
        if motion is not None:
            self.motions.append(motion)
        self.poses.append(np.array(pose))
        self.estimates.append(np.array(estimate))
        self.coverage.append(coverage)

    def add_links(self, measurements: Mapping[str, Measurement], radios: Mapping[str, RadioLink]) -> None:
        """Add measurements by transmitter, as the robot interprets them, with the truth about each."""
        for name, measurement in measurements.items():
            links = self.links if name == "target" else self.anchor_links.setdefault(name, [])
            radio, is_received = radios[name], len(measurement.snr_db) > 0
            error = wrap(float(measurement.aoa_rad[0]) - radio.bearing) if is_received else np.nan
            links.append(
                Link(
                    state=radio.state,
                    believed=measurement.state,
                    snr_db=float(measurement.snr_db[0]) if is_received else -np.inf,
                    sight_loss_db=radio.sight_loss_db,
                    aoa_error_rad=abs(error),
                )
            )

    @property
    def steps(self) -> int:
        """Actions done."""
        return len(self.motions)

    @property
    def arrived(self) -> bool:
        """Whether the robot truly is within the arrival radius now."""
        return bool(np.hypot(*(self.poses[-1][:2] - self.task.target)) <= ARRIVAL_M)

    @property
    def arrived_at(self) -> int | None:
        """The first step after which the robot truly was within the arrival radius, or None."""
        gap = np.hypot(*(np.array(self.poses)[:, :2] - self.task.target).T) if self.poses else np.array([])
        inside = np.flatnonzero(gap <= ARRIVAL_M)
        return int(inside[0]) if len(inside) else None

    @property
    def path_length_m(self) -> float:
        """Length of the true path until the robot arrived, or to its end [m]."""
        legs = np.hypot(*np.diff(np.array(self.poses)[:, :2], axis=0).T)
        return float(legs[: self.arrived_at].sum())

    def result(self) -> dict[str, Any]:
        """Scores of the episode, all but the times the same for the same seed."""
        poses, estimates = np.array(self.poses), np.array(self.estimates)
        error = np.hypot(*(estimates - poses)[:, :2].T)
        arrived_at = self.arrived_at
        path = self.path_length_m
        first_gap, gap = np.hypot(*(poses[[0, -1], :2] - self.task.target).T).tolist()
        ratio = 1.0 if max(path, self.task.shortest_m) == 0 else None
        ratio = self.task.shortest_m / max(path, self.task.shortest_m) if ratio is None else ratio
        progress = 1.0 if arrived_at is not None else max(1 - gap / max(first_gap, ARRIVAL_M), 0.0)
        return {
            "ended": self.ended,
            "arrived": arrived_at is not None,
            "arrived_at_step": arrived_at,
            "steps": self.steps,
            "path_length_m": path,
            "shortest_m": self.task.shortest_m,
            "spl": ratio if arrived_at is not None else 0.0,
            "soft_spl": progress * ratio,
            "final_distance_m": gap,
            "collisions": sum(motion.collided for motion in self.motions),
            "deepest_penetration_m": max((motion.penetration_m for motion in self.motions), default=0.0),
            "coverage": self.coverage[-1],
            "position_error_rms_m": float(np.sqrt(np.mean(error**2))),
            "position_error_last_m": float(error[-1]),
            "start": self.task.start,
            "target": self.task.target,
            "simulated_s": float(self.times()[-1]),
            **_contact_result(self.contacts),
            **_radio_result(self.links),
            **(self._where_found("target", self.task.target) if self.links else {}),
            **({"anchors": self._anchor_results()} if self.task.anchors else {}),
        }

    def _anchor_results(self) -> dict[str, Any]:
        """Return the scores of each other transmitter."""
        return {
            anchor.name: {
                "place": anchor.place,
                "known": anchor.known,
                **_radio_result(self.anchor_links.get(anchor.name, [])),
                **self._where_found(anchor.name, anchor.place),
            }
            for anchor in self.task.anchors
        }

    def _where_found(self, name: str, place: Float[np.ndarray, "2"]) -> dict[str, Any]:
        """Mapped position of a transmitter, its standard deviation and its error; None where it was not mapped."""
        transmitter = self.transmitters.get(name)
        return {
            "transmitter": transmitter and transmitter.xy,
            "transmitter_std_m": transmitter and float(np.sqrt(np.trace(transmitter.covariance))),
            "transmitter_error_m": transmitter and float(np.hypot(*(transmitter.xy - place))),
        }

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw true and estimated trajectory, and the target if it is searched for; None for axes of a new figure."""
        from matplotlib.patches import Circle

        axes = axes_in_metres(axes)
        poses, estimates = (np.reshape(track, (-1, 3)) for track in (self.poses, self.estimates))
        axes.plot(*poses[:, :2].T, color=TRUE, lw=1.8, label="true trajectory")
        axes.plot(*estimates[:, :2].T, color=ESTIMATE, lw=1.0, label="estimated trajectory")
        axes.plot(*poses[:1, :2].T, "o", color=TRUE, label="start")
        if self.seeks_target:
            axes.plot(*self.task.target, "*", color=TARGET, ms=13, label="target")
            axes.add_patch(Circle(tuple(self.task.target), ARRIVAL_M, fill=False, color=TARGET, lw=0.8))
        for anchor in self.task.anchors:
            axes.plot(*anchor.place, "^", color=TARGET, ms=7, mfc=TARGET if anchor.known else "none")
            axes.annotate(
                anchor.name.replace("$", r"\$"),
                tuple(anchor.place),
                xytext=(4, 4),
                textcoords="offset points",
                fontsize=7,
            )
        axes.legend(loc="upper left", fontsize=7, framealpha=0.8)
        return axes

    def save_trajectories(self, folder: Path) -> None:
        """Write `trajectory.tum` (true) and `estimate.tum` (estimated)."""
        for name, poses in (("trajectory", self.poses), ("estimate", self.estimates)):
            write_tum(Path(folder) / f"{name}.tum", self.times(), np.array(poses))

    def times(self) -> Float[np.ndarray, " n"]:
        """Simulated time at each pose [s]."""
        # evo requires increasing times, also where a blocked robot gave up at once.
        steps = [max(motion.duration_s, 1e-3) for motion in self.motions]
        return np.concatenate([[0.0], np.cumsum(steps)])


def _contact_result(contacts: list[Contact] | None) -> dict[str, Any]:
    """Count contacts with moving bodies: caused by the robot, and by a body that came nearer the faster."""
    if contacts is None:
        return {}
    by_robot = sum(contact.by_robot for contact in contacts)
    return {"contacts_by_robot": by_robot, "contacts_by_others": len(contacts) - by_robot}


def _radio_result(links: list[Link]) -> dict[str, Any]:
    """How accurate link states and directions were, over the episode."""
    if not links:
        return {}
    result: dict[str, Any] = {"link_state_accuracy": np.mean([link.state == link.believed for link in links])}
    for state in (LinkState.LOS, LinkState.FIRST_ORDER, LinkState.HIGHER_ORDER):
        name = state.name.lower()
        mine = [link for link in links if link.state == state]
        result[f"{name}_share"] = len(mine) / len(links)
        near = [link.aoa_error_rad <= np.deg2rad(5) for link in mine]
        result[f"{name}_aoa_within_5_deg"] = np.mean(near) if near else None
    losses = [link.sight_loss_db for link in links if link.sight_loss_db == link.sight_loss_db]
    if losses:
        result["sight_blocked_share"] = float(np.mean(np.array(losses) > _BLOCKED_DB))
    return result
