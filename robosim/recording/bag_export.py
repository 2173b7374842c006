"""A recorded episode as a ROS 2 bag in MCAP, for rosbags, Foxglove, Rerun and ROS tools.

    /tf, /tf_static           map to odom (correction by the mapper), odom to base_link, sensors on the base (REP 105);
                              map to base_link_true
    /odom, /scan              integrated odometry, with its mean velocities since the message before; the lidar, if the
                              robot has one
    /cmd_vel                  commanded velocities, if the controller gives them
    /camera/...               image, depth [mm] and camera_info
    /map, /plan, /goal        the robot's map, path and goal
    /belief                   levels of the logarithm of the probability, 0 to 100
    /link_state, /arrivals    estimated link state; an arrow for each estimated path, longer by its additional
                              length, fainter if it is weaker
    /true_pose                ground truth

Times are simulated times, from 0. A layout for Foxglove lies next to the bag.
"""

import json
import math
import os
import shutil
from collections.abc import Iterator
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.constants import speed_of_light

from robosim.camera.model import CameraConfig
from robosim.layers import FREE, GUESS, TOP_LEVEL, UNKNOWN, Layer
from robosim.recording.episode_file import RecordedEpisode, read_team
from robosim.step import Step
from robosim.support.colours import STATE_COLOURS
from robosim.support.files import partial_path, write_whole
from robosim.support.installation import is_installed, missing_extra
from robosim.support.reading import reading
from robosim.support.text_in import check_object, parse_json
from slam.actions import Velocity
from slam.poses import between, compose
from slam.sensing.laser import LaserScan

#: Name of the bag, a folder with an MCAP file, and of the layout.
BAG, LAYOUT = "episode_bag", "foxglove.json"
#: Topics that all robots share.
_SHARED = ("/tf", "/tf_static")
#: Topics whose last messages late subscribers receive too.
_LATCHED = ("/tf_static", "/map")
#: Length of the arrow of a path without additional delay [m], and its thickness.
_ARROW_M, _SHAFT_M = 0.6, 0.03
#: An arrow of a path this much weaker than the strongest is as faint as it gets [dB], and its opacity.
_FAINT_DB, _FAINT = 30.0, 0.2
#: A camera's axes (x right, y down, z ahead) in those of the base, as a quaternion x, y, z, w.
_OPTICAL = (-0.5, 0.5, -0.5, 0.5)


def export_bag(folder: Path, out: Path | None = None) -> Path:
    """Write the bag of the episode in a folder; returns the bag's folder.

    Topics and frames of a team's robots, but `map`, begin with the robot's name.

    Raises:
        FileError: If the episode is damaged.
        ImportError: If `rosbags` is not installed.
    """
    require_rosbags()
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
    from rosbags.rosbag2 import StoragePlugin, Writer

    # Without transient durability, tf2 and map servers receive nothing of what is played.
    lasting, none = (QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL), QosTime(0, 0)
    latched = Qos(QosHistory.KEEP_LAST, 100, *lasting, none, none, QosLiveliness.AUTOMATIC, none, False)
    episodes = {name: (episode, _camera(folder / name)) for name, episode in read_team(folder).items()}
    bag = (out or folder) / BAG
    partial = partial_path(bag)
    shutil.rmtree(partial, ignore_errors=True)
    with Writer(partial, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections: dict[str, Any] = {}
        for name, (episode, camera) in episodes.items():
            messages = _Messages(name)
            for topic, time_s, message in messages.of(episode, episode.times, camera):
                kind = message.__msgtype__
                if name and topic not in _SHARED:
                    topic = f"/{name}{topic}"
                if topic not in connections:
                    connections[topic] = writer.add_connection(
                        topic,
                        kind,
                        typestore=messages.store,
                        offered_qos_profiles=[latched] if topic.endswith(_LATCHED) else [],
                    )
                content = messages.store.serialize_cdr(message, kind)
                writer.write(connections[topic], round(1e9 * time_s), content)
    # The file in the folder has the folder's name, which metadata.yaml repeats.
    metadata = partial / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace(partial.name, BAG))
    (partial / f"{partial.name}.mcap").rename(partial / f"{BAG}.mcap")
    shutil.rmtree(bag, ignore_errors=True)
    os.replace(partial, bag)
    write_whole(bag.parent / LAYOUT, json.dumps(_layout(next(iter(episodes))), indent=1).encode())
    return bag


def require_rosbags() -> None:
    """Raise ImportError if `rosbags`, of the extra `bags`, is not installed."""
    if not is_installed("rosbags"):
        raise missing_extra("rosbags", "A ROS bag")


def _camera(folder: Path) -> CameraConfig:
    """The camera of an episode."""
    with reading(folder / "result.json", "the result of an episode", "Run the episode again.") as file:
        config = check_object(parse_json(file.read())["config"], ("simulator",))
        simulator = check_object(config["simulator"], ("robot",))
        camera = check_object(simulator["robot"]).get("camera")
        return CameraConfig(**check_object(camera or {}))


def _mean_rates(displacement: Float[np.ndarray, "3"], duration_s: float) -> Float[np.ndarray, "3"]:
    """Constant velocities [m/s], [m/s], [rad/s] in the robot's frame that give a displacement; zero in no time."""
    x, y, turn = displacement
    half = turn / 2
    stretch = half / math.tan(half) if half else 1.0
    return np.array([stretch * x + half * y, stretch * y - half * x, turn]) / (duration_s or math.inf)


class _Messages:
    """Messages of ROS 2 of an episode."""

    def __init__(self, robot: str = "") -> None:
        """Begin; frames of a named robot, but `map`, begin with its name."""
        from rosbags.typesys import Stores, get_typestore

        self.store = get_typestore(Stores.ROS2_HUMBLE)
        self._robot = robot

    def _frame(self, name: str) -> str:
        return f"{self._robot}/{name}" if self._robot and name != "map" else name

    def of(
        self, episode: RecordedEpisode, times: Float[np.ndarray, " m"], camera: CameraConfig
    ) -> Iterator[tuple[str, float, Any]]:
        """Topics, times [s] and messages."""
        displacements = episode.columns["odometry"][1:]
        odometry = list(accumulate(displacements, compose, initial=np.zeros(3)))
        rates = [np.zeros(3), *map(_mean_rates, displacements, np.diff(times))]
        place = self._pose((camera.ahead_m, 0.0, camera.height_m), _OPTICAL)
        yield "/tf_static", 0.0, self._tf(0.0, "base_link", "camera", place)
        map_: Layer | None = None
        for step, odom, rate, time_s in zip(episode.steps(), odometry, rates, times, strict=False):
            laser, estimate = step.sensed.laser, step.estimated.pose
            if step.number == 0 and laser is not None:
                raised = self._pose((laser.ahead_m, 0.0, laser.height_m))
                yield "/tf_static", 0.0, self._tf(0.0, "base_link", "laser", raised)
            correction = compose(estimate, between(odom, np.zeros(3)))
            for parent, child, pose in (
                ("map", "odom", correction),
                ("odom", "base_link", odom),
                ("map", "base_link_true", step.true.pose),
            ):
                yield "/tf", time_s, self._tf(time_s, parent, child, self._planar(pose))
            yield "/odom", time_s, self._odometry(time_s, odom, rate)
            if isinstance(command := step.decided.command, Velocity):
                header, twist = (
                    self._header(time_s, "base_link"),
                    self._twist(command.v_mps, 0.0, command.w_radps),
                )
                yield (
                    "/cmd_vel",
                    time_s,
                    self._make("geometry_msgs/msg/TwistStamped", header=header, twist=twist),
                )
            yield "/true_pose", time_s, self._stamped(time_s, step.true.pose)
            if laser is not None:
                yield "/scan", time_s, self._scan(time_s, laser)
            if step.sensed.rgb.size:
                yield from self._pictures(time_s, step, camera)
            if step.map_layer is not map_:
                map_ = step.map_layer
                yield "/map", time_s, self._map(time_s, map_)
            yield "/goal", time_s, self._stamped(time_s, np.array([*step.decided.goal, 0.0]))
            yield "/plan", time_s, self._path(time_s, step.decided.path)
            if step.belief_layer is not None:
                shares = np.rint(100 / TOP_LEVEL * step.belief_layer.values).astype(np.int8)
                yield "/belief", time_s, self._grid(time_s, step.belief_layer, shares)
            if (measured := step.estimated.measurement) is not None:
                yield (
                    "/link_state",
                    time_s,
                    self._make("std_msgs/msg/String", data=measured.state.name.lower()),
                )
                yield "/arrivals", time_s, self._arrivals(time_s, step)

    def _make(self, kind: str, **values: Any) -> Any:
        """A message; fields without a value are zero or empty."""
        fields = dict(self.store.fielddefs[kind][1])
        unset = {name: self._zero(*form) for name, form in fields.items() if name not in values}
        return self.store.types[kind](__msgtype__=kind, **values, **unset)

    def _zero(self, node: int, form: Any) -> Any:
        """The zero of a type of `rosbags`: a number or text (1), a message (2), an array (3) or a sequence (4)."""
        if node == 1:
            return "" if form[0] == "string" else np.dtype(form[0]).type(0).item()
        if node == 2:
            return self._make(form)
        (of, element), length = form
        return np.zeros(length, element[0]) if of == 1 else []

    def _header(self, time_s: float, frame: str) -> Any:
        nanoseconds = round(1e9 * time_s)
        stamp = self._make(
            "builtin_interfaces/msg/Time", sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9
        )
        return self._make("std_msgs/msg/Header", stamp=stamp, frame_id=self._frame(frame))

    def _pose(
        self, xyz: tuple[float, float, float], quaternion: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)
    ) -> Any:
        position = self._make("geometry_msgs/msg/Point", **dict(zip("xyz", map(float, xyz), strict=True)))
        turn = self._make(
            "geometry_msgs/msg/Quaternion", **dict(zip("xyzw", map(float, quaternion), strict=True))
        )
        return self._make("geometry_msgs/msg/Pose", position=position, orientation=turn)

    def _planar(self, pose: Float[np.ndarray, "3"]) -> Any:
        x, y, yaw = pose.tolist()
        return self._pose((x, y, 0.0), (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))

    def _stamped(self, time_s: float, pose: Float[np.ndarray, "3"]) -> Any:
        header = self._header(time_s, "map")
        return self._make("geometry_msgs/msg/PoseStamped", header=header, pose=self._planar(pose))

    def _tf(self, time_s: float, parent: str, child: str, pose: Any) -> Any:
        at = pose.position
        vector = self._make("geometry_msgs/msg/Vector3", x=at.x, y=at.y, z=at.z)
        transform = self._make(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(time_s, parent),
            child_frame_id=self._frame(child),
            transform=self._make(
                "geometry_msgs/msg/Transform", translation=vector, rotation=pose.orientation
            ),
        )
        return self._make("tf2_msgs/msg/TFMessage", transforms=[transform])

    def _twist(self, vx_mps: float, vy_mps: float, w_radps: float) -> Any:
        linear = self._make("geometry_msgs/msg/Vector3", x=vx_mps, y=vy_mps)
        angular = self._make("geometry_msgs/msg/Vector3", z=w_radps)
        return self._make("geometry_msgs/msg/Twist", linear=linear, angular=angular)

    def _odometry(self, time_s: float, pose: Float[np.ndarray, "3"], rates: Float[np.ndarray, "3"]) -> Any:
        return self._make(
            "nav_msgs/msg/Odometry",
            header=self._header(time_s, "odom"),
            child_frame_id=self._frame("base_link"),
            pose=self._make("geometry_msgs/msg/PoseWithCovariance", pose=self._planar(pose)),
            twist=self._make("geometry_msgs/msg/TwistWithCovariance", twist=self._twist(*rates.tolist())),
        )

    def _scan(self, time_s: float, laser: LaserScan) -> Any:
        return self._make(
            "sensor_msgs/msg/LaserScan",
            header=self._header(time_s, "laser"),
            angle_min=float(laser.bearing_rad[0]),
            angle_max=float(laser.bearing_rad[-1]),
            angle_increment=laser.step_rad,
            range_max=laser.max_range_m,
            ranges=laser.range_m.astype(np.float32),
        )

    def _pictures(self, time_s: float, step: Step, camera: CameraConfig) -> Iterator[tuple[str, float, Any]]:
        header = self._header(time_s, "camera")
        depth_mm = np.rint(1000 * step.sensed.depth).astype("<u2")
        for name, encoding, pixels in (("image", "rgb8", step.sensed.rgb), ("depth", "16UC1", depth_mm)):
            rows = np.ascontiguousarray(pixels).reshape(len(pixels), -1).view(np.uint8)
            image = self._make(
                "sensor_msgs/msg/Image",
                header=header,
                height=pixels.shape[0],
                width=pixels.shape[1],
                encoding=encoding,
                step=rows.shape[1],
                data=rows.ravel(),
            )
            yield f"/camera/{name}", time_s, image
        # Pixel centres are at whole numbers in ROS, at halves here.
        k = camera.K - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
        info = self._make(
            "sensor_msgs/msg/CameraInfo",
            header=header,
            height=camera.height,
            width=camera.width,
            distortion_model="plumb_bob",
            d=np.zeros(5),
            k=k.ravel(),
            r=np.eye(3).ravel(),
            p=np.column_stack([k, np.zeros(3)]).ravel(),
        )
        yield "/camera/camera_info", time_s, info

    def _map(self, time_s: float, layer: Layer) -> Any:
        cells = np.full(layer.values.shape, 100, np.int8)
        cells[layer.values == FREE] = 0
        cells[(layer.values == UNKNOWN) | (layer.values >= GUESS)] = -1
        return self._grid(time_s, layer, cells)

    def _grid(self, time_s: float, layer: Layer, cells: np.ndarray) -> Any:
        header = self._header(time_s, "map")
        x, y = layer.frame.origin_xy
        info = self._make(
            "nav_msgs/msg/MapMetaData",
            map_load_time=header.stamp,
            resolution=layer.frame.resolution_m,
            width=layer.frame.shape[1],
            height=layer.frame.shape[0],
            origin=self._pose((x, y, 0.0)),
        )
        return self._make("nav_msgs/msg/OccupancyGrid", header=header, info=info, data=cells.ravel())

    def _path(self, time_s: float, path: Float[np.ndarray, "n 2"]) -> Any:
        poses = [self._stamped(time_s, np.array([*point, 0.0])) for point in path]
        return self._make("nav_msgs/msg/Path", header=self._header(time_s, "map"), poses=poses)

    def _arrivals(self, time_s: float, step: Step) -> Any:
        """Arrows to where each path arrives from, the strongest first; a delay that is not resolved adds no length."""
        measured = step.estimated.measurement
        assert measured is not None
        red, green, blue = (value / 255 for value in STATE_COLOURS[measured.state])
        arrows: list[tuple[dict[str, Any], float, float]] = [
            (
                {"action": 3, "id": 0, "pose": self._pose((0.0, 0.0, 0.0))},
                _ARROW_M,
                1.0,
            )  # deletes those before
        ]
        delay_s = np.nan_to_num(measured.delay_s)
        for number, k in enumerate(measured.directed.tolist(), 1):
            azimuth, (x, y, _) = float(measured.aoa_rad[k]), measured.pose.tolist()
            length_m = _ARROW_M + speed_of_light * float(delay_s[k] - delay_s.min())
            weaker_db = float(measured.snr_db[0] - measured.snr_db[k])
            alpha = max(1.0 - (1 - _FAINT) * weaker_db / _FAINT_DB, _FAINT)
            turn = (0.0, 0.0, math.sin(azimuth / 2), math.cos(azimuth / 2))
            arrow = {"action": 0, "id": number, "pose": self._pose((x, y, 1.0), turn)}
            arrows.append((arrow, length_m, alpha))
        markers = [
            self._make(
                "visualization_msgs/msg/Marker",
                header=self._header(time_s, "map"),
                ns="arrivals",
                scale=self._make("geometry_msgs/msg/Vector3", x=length_m, y=_SHAFT_M, z=_SHAFT_M),
                color=self._make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=alpha),
                **arrow,
            )
            for arrow, length_m, alpha in arrows
        ]
        return self._make("visualization_msgs/msg/MarkerArray", markers=markers)


def _layout(robot: str) -> dict[str, Any]:
    """The world next to camera and link state, for Foxglove; of the robot of a name, if it has one."""
    prefix = robot and f"/{robot}"
    topics = [f"{prefix}/{topic}" for topic in ("map", "scan", "plan", "goal", "arrivals", "true_pose")]
    world = {"followTf": "map", "topics": {topic: {"visible": True} for topic in topics}}
    panels = {
        "3D!world": world,
        "Image!camera": {"imageMode": {"imageTopic": f"{prefix}/camera/image"}},
        "RawMessages!link": {"topicPath": f"{prefix}/link_state.data"},
    }
    column = {"first": "Image!camera", "second": "RawMessages!link", "direction": "column"}
    layout = {"first": "3D!world", "second": column, "direction": "row", "splitPercentage": 70}
    return {"configById": panels, "globalVariables": {}, "layout": layout, "userNodes": {}}
