"""Logs of robots in ROS 1 and ROS 2 bags (SQLite and MCAP), read without ROS; `rosbags` decodes messages.

Scans are of the first of these kinds that has messages: LaserScan, MultiEchoLaserScan (first echoes), PointCloud2,
PointCloud, and depth images with their CameraInfo; of the last three, points in a slice at a height above the base
become a scan. Odometry is that of Odometry messages, or of the transforms between an odometry frame and the base (REP
105). Poses are those of base_link, or of a chosen frame. Times are those of the headers, or of the
recording where headers have none. Readings that come late or twice are sorted and dropped, and reported.
"""

import logging
import math
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from robosim.logs.bag_files import storage_files
from robosim.logs.bag_messages import CAMERA, IMAGE, ODOMETRY, TF, Bag
from robosim.logs.bag_scans import DEPTHS, LASERS, SOURCES, Scan, is_distorted, scan_maker
from robosim.logs.beam_times import OdometryTrack
from robosim.logs.frames import MOST_TIPPED, Frames, Places, frame_name, matrices, planar, stamp_s
from robosim.logs.no_returns import find_no_returns
from robosim.logs.robot_log import LONGEST_TURN, BagTopics, LogReader, RobotLog, report_track
from robosim.support.installation import is_installed, missing_extra
from robosim.support.reading import FileError, naming
from slam.poses import Pose, between, wrap

logger = logging.getLogger(__name__)

_REMEDY = "Record or export it again, such as by rosbags-convert."
#: A forward-looking camera's axes (x right, y down, z ahead) in those of its body (REP 103).
_OPTICAL = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
#: A sensor that moves by less on the base is fixed [m, rad].
_FIXED_M, _FIXED_RAD = 0.02, math.radians(1)
_AT_BASE = "the sensor counts as at the base"
#: Clocks of two topics differ if their delays do by more, and vary by less [s].
_CLOCK_S, _STEADY_S = 1.0, 0.3
#: A sensor farther from the base is reported [m], and headers that pass so many times faster than the recording.
_FAR_M, _RATE = 5.0, 50.0
#: An `angle_max` farther from the last beam is reported; many drivers are off by a beam [rad].
_BEYOND_RAD = 0.1
#: The clock was reset where so many scans follow one another at times between those of scans before.
_RESTART_SCANS = 10
#: A larger part of the scans outside of odometry's time is reported.
_OUTSIDE = 0.05


def is_bag(path: Path) -> bool:
    """Whether a path is a ROS 1 bag, a ROS 2 bag or a folder with one, or an MCAP file."""
    return bool(storage_files(path))


class BagReader(LogReader):
    """Reads bags."""

    def matches(self, path: Path) -> bool:
        """Whether a path is a bag."""
        return is_bag(path)

    def read(self, path: Path, scans: Path | None, topics: BagTopics) -> RobotLog:
        """Read a bag; see `read_bag`."""
        return read_bag(path, topics)


def read_bag(path: Path, topics: BagTopics | None = None, report: dict[str, Any] | None = None) -> RobotLog:
    """Read scans and odometry of a bag.

    Args:
        path: A `.bag`, `.db3` or `.mcap` file, or the folder of a ROS 2 bag.
        topics: What to read of it.
        report: Gets what was read, step by step, by name.

    Raises:
        FileError: If the bag is damaged, lacks scans, or has several topics to choose from.
        ImportError: If `rosbags` is not installed.
    """
    if not is_installed("rosbags"):
        raise missing_extra("rosbags", f"{path}: a ROS bag")
    report = {} if report is None else report
    with naming(path, "a ROS bag", _REMEDY):
        log = _Reading(path, topics or BagTopics(), report).log()
    for text in report["assumed"]:
        logger.warning(f"{path}: {text}.")
    if log.track is not None:
        report_track(path, log.track)
    return log


class _Reading:
    """Reads a bag, and reports what it reads and assumes."""

    def __init__(self, path: Path, topics: BagTopics, report: dict[str, Any]) -> None:
        self._path, self._given, self._report = path, topics, report
        self._frames = Frames()
        self._odometry: dict[str, list[tuple[float, ...]]] = {}
        self._delays: dict[str, list[float]] = {}
        self._frame_names: dict[str, set[tuple[str, str]]] = {}
        report["assumed"] = []
        self._bag = Bag(path)
        names = ("topic", "type", "read", "messages", "span_s")
        report["topics"] = [
            dict(
                zip(names, (name, topic.type_name, bool(topic.kind), topic.count, topic.span_s), strict=True)
            )
            for name, topic in sorted(self._bag.topics.items())
        ]
        if self._bag.lost:
            self._note(self._bag.lost)

    def log(self) -> RobotLog:
        """Read scans and odometry."""
        bag, frames, report = self._bag, self._frames, self._report
        types = {name: topic.kind for name, topic in bag.topics.items() if topic.kind}
        colour = {name for name in bag.of_kinds(IMAGE) if bag.topics[name].first.encoding not in DEPTHS}
        scan_topic = ""
        try:
            scan_topic = _scan_topic(bag, types, colour, self._given.scan_topic)
        finally:  # frames are reported without scans, too
            self._read_motion(scan_topic)
            report["frames"] = [
                {"depth": depth, "frame": name, "kind": kind} for depth, name, kind in frames.tree()
            ]
        odometry_topic = _choice(
            types, self._given.odometry_topic, (ODOMETRY,), "odometry", "--odometry-topic"
        )
        head = bag.topics[scan_topic].first.header
        sensor, kind = frame_name(head.frame_id), types[scan_topic]
        child = frame_name(bag.topics[odometry_topic].first.child_frame_id) if odometry_topic else ""
        base = _base(frames, sensor, child)
        frame = self._given.frame or base
        if frame != base and not frames.is_connected(base, frame):
            known = [name for name in frames.names() if frames.is_connected(base, name)] or [base]
            raise FileError(
                f"no transform leads from {frame!r} to {base}, expected one of {', '.join(known)}."
            )
        for name in {*frames.chain(sensor), *frames.chain(base)} & set(frames.other_parents):
            others = ", ".join(sorted(frames.other_parents[name]))
            self._note(f"{name} has several parents; {frames.chain(name)[1]} counts, and {others} does not")
        report |= {"scan_topic": scan_topic, "sensor_frame": sensor, "base_frame": base, "frame": frame}
        place = self._places(base, sensor, np.array([stamp_s(head)]), _AT_BASE)[0]
        if kind not in LASERS and sensor not in frames:
            self._note(f"no transform has {sensor}: --slice-m counts from the sensor, which looks ahead")
            place = _OPTICAL if kind == IMAGE else place
        # The CameraInfo of images is in their namespace; that of the colour camera may have the same frame.
        infos = sorted(bag.of_kinds(CAMERA), key=lambda name: _namespace(name) != _namespace(scan_topic))
        firsts = [bag.topics[name].first for name in infos]
        cameras = [info for info in firsts if frame_name(info.header.frame_id) == sensor]
        is_rectified = re.search(r"[/_]rect(ified)?([/_]|$)", scan_topic) is not None
        if kind == IMAGE and cameras and not is_rectified and is_distorted(cameras[0]):
            self._note(
                f"{scan_topic} is read as a raw image, by K of its CameraInfo, and its distortion is not undone; "
                "record the rectified one (image_rect), which P describes"
            )
        make = scan_maker(kind, place, self._given.slice_m, cameras, is_rectified)
        scans = [make(self._timed(*record)) for record in bag.messages(scan_topic)]
        self._check_frames(scan_topic)
        scans = self._with_returns(self._in_order(scans), scan_topic)
        self._check_times(scan_topic, scans)
        times = np.array([scan.time_s for scan in scans])
        turn_s, usual_s = max(max(scan.beam_s or [0.0]) for scan in scans), float(np.median(np.diff(times)))
        if turn_s > LONGEST_TURN * usual_s:
            self._note(
                f"time_increment of {scan_topic} makes scans of {turn_s:.3g} s, which follow each other after "
                f"{usual_s:.3g} s: all beams count as of one moment; --beam-seconds gives their times"
            )
            scans = [scan._replace(beam_s=None) for scan in scans]
        mount = self._mount(base, frame, sensor, times, kind in LASERS)
        track = self._track(odometry_topic, child, base, frame, times, scan_topic)
        report["odometry_span_s"] = None if track is None else (track.times[0], track.times[-1])
        return _log(self._path, scans, track, mount)

    def _note(self, text: str) -> None:
        """Report what is assumed or missing."""
        if text not in self._report["assumed"]:
            self._report["assumed"].append(text)

    def _timed(self, topic: str, time_s: float, message: Any) -> Any:
        """A message; its delay from the header's time to the recording, and its frames are stored."""
        header = message.header if hasattr(message, "header") else message.transforms[0].header
        self._delays.setdefault(topic, []).append(time_s - stamp_s(header))
        names = frame_name(header.frame_id), frame_name(getattr(message, "child_frame_id", ""))
        self._frame_names.setdefault(topic, set()).add(names)
        return message

    def _check_frames(self, topic: str) -> None:
        """Raise FileError for a topic whose messages are of several frames, as of several sensors."""
        if len(names := self._frame_names[topic]) > 1:
            shown = ", ".join(sorted(" > ".join(filter(None, pair)) for pair in names))
            raise FileError(
                f"{topic} has messages of the frames {shown}, expected a single frame. Record a topic for each."
            )

    def _read_motion(self, scan_topic: str) -> None:
        """Read transforms and odometry; of transforms in namespaces of several robots, those of the scans' robot."""
        bag, rows, transforms = self._bag, self._odometry, self._bag.of_kinds(TF)
        near = [
            name for name in transforms if f"{_namespace(scan_topic)}/".startswith(f"{_namespace(name)}/")
        ]
        if any(map(_namespace, near)) and (others := set(transforms) - {*near}):
            transforms = near
            self._note(
                f"{', '.join(sorted(others))} do not count, as their namespace is not that of {scan_topic}"
            )
        for topic, time_s, message in bag.messages(*transforms, *bag.of_kinds(ODOMETRY)):
            if bag.topics[topic].kind == TF:
                self._frames.add(message, time_s)
                if message.transforms and bag.topics[topic].count > 2:
                    self._timed(topic, time_s, message)
                continue
            pose = getattr(self._timed(topic, time_s, message).pose, "pose", message.pose)
            place, turn = pose.position, pose.orientation
            row = (stamp_s(message.header), place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w)
            rows.setdefault(topic, []).append(row)

    def _places(self, target: str, source: str, times: Float[np.ndarray, " n"], otherwise: str) -> Places:
        """Places of a frame in another; where no transform leads there, they are the same, which is reported."""
        if target == source:
            return np.tile(np.eye(4), (len(times), 1, 1))
        if self._frames.is_connected(target, source):
            return self._frames.places(target, source, times)
        self._note(f"no transform leads from {source} to {target}: {otherwise}")
        return np.tile(np.eye(4), (len(times), 1, 1))

    def _with_returns(self, scans: list[Scan], topic: str) -> list[Scan]:
        """Scans without the beams that hit nothing; FileError if none hits anything."""
        at_limit, below, below_m = find_no_returns(
            [scan.range_m for scan in scans], [scan.limit_m for scan in scans]
        )
        hits_nothing = at_limit | below
        ranges = np.where(hits_nothing, np.inf, np.concatenate([scan.range_m for scan in scans]))
        if max(len(scan.range_m) for scan in scans) < 2:
            raise FileError(f"scans of {topic} have one beam or none, expected two at least.")
        beyond_rad = max(scan.beyond_rad for scan in scans)
        if not beyond_rad < _BEYOND_RAD:
            self._note(
                f"angle_max of {topic} is {beyond_rad:.3g} rad from its last beam: angle_min and angle_increment count"
            )
        n_without = np.count_nonzero(~np.isfinite(ranges))
        if n_without == len(ranges):
            raise FileError(
                f"none of the {len(ranges)} beams of {topic} hits anything, expected ranges between range_min and "
                "range_max, or points at the height --slice-m."
            )
        if below.any():
            share = 100 * below.mean()
            self._note(
                f"{share:.0f} % of the beams end at {below_m:.4g} m, below range_max: they hit nothing"
            )
        self._report |= {
            "scans": len(scans),
            "beams": max(len(scan.range_m) for scan in scans),
            "scan_span_s": (scans[0].time_s, scans[-1].time_s),
            "share_at_limit": float(hits_nothing.mean()),
            "share_without_return": n_without / len(ranges),
        }
        ends = np.cumsum([len(scan.range_m) for scan in scans])[:-1]
        return [scan._replace(range_m=each) for scan, each in zip(scans, np.split(ranges, ends), strict=True)]

    def _in_order(self, scans: list[Scan]) -> list[Scan]:
        """Scans by rising times, without those of a time that is there already."""
        times = np.array([scan.time_s for scan in scans])
        drops = np.flatnonzero(np.diff(times) < 0) + 1
        for k, run in zip(drops, np.split(times, drops)[1:], strict=True):
            before = times[:k]
            again = run[run < before.max()]
            between_s = (before > again[0]) & (before < again[-1])
            if len(again) >= _RESTART_SCANS and between_s.any() and not np.isin(again, before).all():
                raise FileError(
                    f"the clock goes back from {times[k - 1]:.3f} to {run[0]:.3f} s, and {len(again)} scans of two "
                    "runs lie between each other. Give a bag for each run."
                )
        ordered = sorted(scans, key=lambda scan: scan.time_s)
        rising = [ordered[0], *(b for a, b in pairwise(ordered) if b.time_s > a.time_s)]
        late = sum(b.time_s < a.time_s for a, b in pairwise(scans))
        if late or len(rising) < len(scans):
            left = f"{len(scans) - len(rising)} have the time of another and are left out"
            self._note(f"{late} scans come before an earlier one and are sorted, {left}")
        if len(rising) < 2:
            raise ValueError(f"{len(rising)} scans at different times in it, expected two at least")
        return rising

    def _check_times(self, topic: str, scans: list[Scan]) -> None:
        """Note times of headers that pass at another rate than those of the recording."""
        first_s, last_s = self._bag.topics[topic].span_s
        recorded_s, stamped_s = last_s - first_s, scans[-1].time_s - scans[0].time_s
        if min(recorded_s, stamped_s) > 0 and not 1 / _RATE < stamped_s / recorded_s < _RATE:
            self._note(
                f"{topic} lasts {stamped_s:.4g} s by its headers, but {recorded_s:.4g} s by the recording"
            )

    def _mount(
        self, base: str, frame: str, sensor: str, times: Float[np.ndarray, " n"], is_laser: bool
    ) -> Pose:
        """Pose of the beams in a frame; that of a slice has the axes of the base. FileError if it is none."""
        places = self._places(base, sensor, times, _AT_BASE)
        poses = planar(places)
        if (away_m := float(np.linalg.norm(places[:, :3, 3], axis=1).max())) > _FAR_M:
            self._note(f"{sensor} is {away_m:.4g} m from {base}: check the transforms")
        if is_laser and (tilt := np.arccos(np.clip(np.abs(places[:, 2, 2]), 0, 1)).max()) > MOST_TIPPED:
            raise FileError(
                f"the laser is tipped by {math.degrees(tilt):.0f} degrees, expected a plane parallel to the floor "
                f"within {math.degrees(MOST_TIPPED):.0f}. Choose another laser by --scan-topic."
            )
        if not is_laser:
            poses[:, 2] = 0.0
        if frame == sensor and is_laser:
            return np.zeros(3)
        if frame != base:
            origins = planar(self._frames.places(base, frame, times))
            poses = np.array([between(a, b) for a, b in zip(origins, poses, strict=True)])
        away = np.abs(poses - poses[0])
        moved_m, turned = float(away[:, :2].max()), float(np.abs(wrap(away[:, 2])).max())
        if moved_m > _FIXED_M or turned > _FIXED_RAD:
            raise FileError(
                f"{sensor} moves on {frame} by up to {moved_m:.2f} m and {math.degrees(turned):.0f} degrees, expected "
                f"a fixed sensor. Give its own trajectory by --frame {sensor}."
            )
        return poses[0]

    def _track(
        self,
        topic: str | None,
        child: str,
        base: str,
        frame: str,
        times: Float[np.ndarray, " n"],
        scan_topic: str,
    ) -> OdometryTrack | None:
        """Odometry of a frame; None where there is none of the scans' time and clock, which is reported."""
        source, frames, track = self._given.odometry_topic, self._frames, None
        self._report["odometry"] = "none"
        if source == "none":
            return None
        if topic is not None:
            self._check_frames(topic)
            values = np.array(self._odometry[topic], float)
            stamps, first = np.unique(values[:, 0], return_index=True)
            places = matrices(f"{topic}", stamps, values[first, 1:])
            if child:
                to_base = self._places(child, base, stamps, "they count as the same")
                moved_m = float(np.ptp(to_base[:, :2, 3], axis=0).max())
                if moved_m > _FIXED_M:
                    self._note(
                        f"{topic} is of {child}, which moves by {moved_m:.2f} m on {base}, where the scans are taken: "
                        "if that is another robot, choose other odometry by --odometry-topic"
                    )
                places = places @ to_base
            track = self._of_frame(topic, stamps, places, base, frame)
        odom = _odometry_frame(frames, base) if track is None and base in frames else None
        if odom is not None and source in (None, "tf"):
            stamps, topic = frames.times(odom, base), f"transforms from {odom} to {base}"
            if len(stamps):
                track = self._of_frame(topic, stamps, frames.places(odom, base, stamps), base, frame)
        if track is None:
            unread = [
                name
                for name, entry in self._bag.topics.items()
                if not entry.kind and re.search("odom|tf", name)
            ]
            n_moving = sum(kind == "moving" for _, _, kind in frames.tree())
            self._note(
                f"no odometry of {base} is used ({len(self._odometry)} topics of odometry, {n_moving} transforms that "
                f"move{''.join(f', {name} of an unknown type' for name in unread)}): scans alone give the motion"
            )
            return None
        spans = (
            f"scans are from {times[0]:.3f} to {times[-1]:.3f} s, odometry from {track.times[0]:.3f} to "
            f"{track.times[-1]:.3f} s"
        )
        apart_s = self._clocks_apart(scan_topic, topic or "")
        n_outside = np.count_nonzero((times < track.times[0]) | (times > track.times[-1]))
        if n_outside == len(times) or apart_s:
            is_apart = n_outside == len(times)
            why = "no time is common" if is_apart else f"{apart_s:.1f} s apart by the times of recording"
            self._note(
                f"{topic} is stamped by another clock than {scan_topic} ({why}): {spans}. Odometry is not used, and "
                "scans alone give the motion; record both by one clock"
            )
            return None
        if n_outside > _OUTSIDE * len(times):
            self._note(f"{n_outside} of {len(times)} scans are outside of odometry's time: {spans}")
        self._report["odometry"] = topic
        return track

    def _of_frame(
        self, name: str, times: Float[np.ndarray, " m"], places: Places, base: str, frame: str
    ) -> OdometryTrack | None:
        """Odometry of a frame from places of the base; None if they never change. FileError if the base is tipped."""
        tilt = np.arccos(np.clip(places[:, 2, 2], -1, 1))
        if tilt.max() > MOST_TIPPED:
            raise FileError(
                f"{name} tips {base} by {math.degrees(tilt.max()):.0f} degrees at {times[tilt.argmax()]:.3f} s, "
                "expected a robot on a floor. Choose other odometry by --odometry-topic, or none."
            )
        if frame != base:
            places = places @ self._frames.places(base, frame, times)
        poses = planar(places)
        if len(poses) < 2 or (np.abs(poses - poses[0]) < 1e-9).all():
            self._note(f"{name} never changes, and does not count as odometry")
            return None
        return OdometryTrack(times=times, poses=poses)

    def _clocks_apart(self, scan_topic: str, odometry: str) -> float:
        """Difference of the clocks of scans and odometry by the delays of recording [s]; 0 if they are one."""
        names = [odometry] if odometry in self._odometry else self._bag.of_kinds(TF)
        motion = [self._delays[name] for name in names if name in self._delays]
        delays = [np.array(self._delays[scan_topic]), np.concatenate(motion)] if motion else []
        if not delays or any(np.subtract(*np.percentile(each, [90, 10])) > _STEADY_S for each in delays):
            return 0.0
        apart_s = float(np.median(delays[0]) - np.median(delays[1]))
        return apart_s if abs(apart_s) > _CLOCK_S else 0.0


def _base(frames: Frames, sensor: str, child: str) -> str:
    """The robot's frame: base_link, base_footprint, odometry's, or the last that static transforms lead to."""
    chain = frames.chain(sensor)
    connected = [name for name in frames.names() if frames.is_connected(name, sensor)]
    near = [*chain, *connected, *([] if child else frames.names())]
    for name in ("base_link", "base_footprint"):
        for frame in near:
            if frame.rpartition("/")[2] == name:
                return frame
    if child:
        return child
    moving = [k for k, name in enumerate(chain[:-1]) if frames.is_moving(name)]
    return chain[moving[0] if moving else -1]


def _odometry_frame(frames: Frames, base: str) -> str | None:
    """The frame that odometry is in: one of that name, or the farthest that moves below the map; None without."""
    chain = frames.chain(base)[1:]
    near = [*chain, *(name for name in frames.names() if frames.is_connected(name, base))]
    moving = [name for name in near if frames.moving(name, base)]
    named = [name for name in moving if "odom" in name.rpartition("/")[2].lower()]
    above = [name for name in chain if name in moving]
    local = [name for name in above if name.rpartition("/")[2] not in ("map", "earth")]
    return next(iter([*named, *local[::-1], *above]), None)


def _log(path: Path, scans: list[Scan], track: OdometryTrack | None, mount: Pose) -> RobotLog:
    """The log; without odometry all displacements are unknown."""
    times = np.array([scan.time_s for scan in scans])
    width = max(len(scan.bearing_rad) for scan in scans)
    bearing = np.array([_padded(scan.bearing_rad, width) for scan in scans])
    ranges = np.array([np.append(scan.range_m, np.full(width - len(scan.range_m), np.nan)) for scan in scans])
    spans = [scan.beam_s or (0.0, 0.0) for scan in scans]
    beam_s = np.array(
        [
            _padded(np.linspace(*ends, len(scan.range_m)), width)
            for ends, scan in zip(spans, scans, strict=True)
        ]
    )
    if (bearing == bearing[0]).all() and (beam_s == beam_s[0]).all():
        bearing, beam_s = bearing[0], beam_s[0]
    displacement, known = np.zeros((len(times), 3)), np.arange(len(times)) == 0
    if track is not None:
        displacement, known = track.steps(times)
        inside = (times >= track.times[0]) & (times <= track.times[-1])
        known[1:] &= inside[1:] & inside[:-1]
        displacement[~known] = 0.0
    return RobotLog(
        name=path.stem,
        file=path,
        bearing_rad=bearing,
        range_m=ranges,
        displacement=displacement,
        known=known,
        times=times,
        beam_s=beam_s if np.any(spans) else None,
        track=track,
        mount=mount,
    )


def _padded(bearing: Float[np.ndarray, " w"], width: int) -> Float[np.ndarray, " v"]:
    """Bearings with the last one repeated."""
    return np.append(bearing, np.full(width - len(bearing), bearing[-1] if len(bearing) else 0.0))


def _namespace(topic: str) -> str:
    return topic.rpartition("/")[0]


def _scan_topic(bag: Bag, types: dict[str, str], colour: set[str], requested: str | None) -> str:
    """The topic that scans come from; not one with colour images."""
    usable = {topic: kind for topic, kind in types.items() if topic not in colour}
    kinds = tuple(kind for group in SOURCES for kind in group)
    for group in (kinds,) if requested else SOURCES:
        if (name := _choice(usable, requested, group, "scans", "--scan-topic")) is not None:
            return name
    shown = ", ".join(f"{name} ({topic.type_name})" for name, topic in sorted(bag.topics.items()))
    lost = f", and {bag.lost}" if bag.lost else ""
    raise FileError(
        f"has no topic of {', '.join(kinds)}; its topics are {shown}{lost}. Record scans, or convert them to a "
        "TUM file and --scans."
    )


def _choice(
    types: dict[str, str], requested: str | None, kinds: tuple[str, ...], what: str, option: str
) -> str | None:
    """A topic of some types: the given one, or the only one; None if there is none."""
    if requested in ("tf", "none"):
        return None
    names = sorted(name for name, kind in types.items() if kind in kinds)
    if requested is not None:
        if requested not in names:
            expected = ", ".join(names) or "none"
            raise FileError(f"{requested!r} is no topic of {what} in it, expected one of {expected}.")
        return requested
    if len(names) > 1:
        raise FileError(f"has {len(names)} topics of {what}: {', '.join(names)}. Choose one by {option}.")
    return names[0] if names else None
