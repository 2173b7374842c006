"""Messages of bags by what their types hold, whatever they are called.

Types were renamed (`tf/tfMessage` became `tf2_msgs/TFMessage`), and drivers have copies of their own. Bags carry the
definitions of their types: a type with the fields of a scan is a scan. Where a bag has no definition, the last word of
the type's name decides, and the definition is that of ROS.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robosim.logs.bag_files import BagFiles, Channel
from robosim.support.reading import FileError, reason_of

SCAN, ECHOES, POINTS, CLOUD, IMAGE = "LaserScan", "MultiEchoLaserScan", "PointCloud2", "PointCloud", "Image"
CAMERA, ODOMETRY, TF = "CameraInfo", "Odometry", "TFMessage"
#: Fields of messages, apart from the header.
_SCAN_FIELDS = {"angle_min", "angle_increment", "range_min", "range_max", "ranges"}
_FIELDS: dict[str, set[str]] = {
    SCAN: _SCAN_FIELDS,
    POINTS: {"height", "width", "fields", "point_step", "row_step", "data"},
    CLOUD: {"points", "channels"},
    IMAGE: {"height", "width", "encoding", "step", "data"},
    CAMERA: {"height", "width", "k", "r", "p", "binning_x", "binning_y", "roi"},
    ODOMETRY: {"child_frame_id", "pose", "twist"},
}
#: Types of ROS, for bags without definitions, by the last word of their name in small letters.
_STANDARD = {
    **{kind.lower(): f"sensor_msgs/msg/{kind}" for kind in (SCAN, ECHOES, POINTS, CLOUD, IMAGE, CAMERA)},
    "odometry": "nav_msgs/msg/Odometry",
    "tfmessage": "tf2_msgs/msg/TFMessage",
}


@dataclass
class Topic:
    """A topic of a bag."""

    type_name: str
    kind: str | None
    """The kind of its messages, such as `LaserScan`; None if it is not read."""
    count: int = 0
    span_s: tuple[float, float] = (float("inf"), -float("inf"))
    """Times of recording of the first and last message [s]."""
    first: Any = None
    """The first message; None of a kind that is not read."""


class Bag:
    """Topics and messages of a bag."""

    def __init__(self, path: Path) -> None:
        self._files = BagFiles(path)
        self._types: dict[tuple[str, str, str], tuple[str | None, str, Any]] = {}
        self.topics: dict[str, Topic] = {}
        """By name, those with messages."""
        for channel, time_ns, data in self._files.records():
            topic = self.topics.get(channel.topic)
            if topic is None:
                kind, _, _ = self._type_of(channel)
                topic = self.topics[channel.topic] = Topic(channel.type_name.replace("/msg/", "/"), kind)
                topic.first = self._message(channel, time_ns, data) if kind else None
            topic.count += 1
            topic.span_s = (min(topic.span_s[0], 1e-9 * time_ns), max(topic.span_s[1], 1e-9 * time_ns))
        self.lost = self._files.lost()
        """Describe the lost messages; empty if none is lost."""
        if not self.topics:
            raise FileError(f"is a bag without messages ({self.lost or 'empty'}). Record or export it again.")

    def of_kinds(self, *kinds: str) -> list[str]:
        """Names of the topics of some kinds."""
        return sorted(name for name, topic in self.topics.items() if topic.kind in kinds)

    def messages(self, *topics: str) -> Iterator[tuple[str, float, Any]]:
        """Yield topic, time of recording [s] and message of all messages of some topics.

        Headers without a time get that of the recording. Messages that cannot be decoded raise a FileError.
        """
        wanted = {name for name in topics if self.topics[name].kind}
        for channel, time_ns, data in self._files.records() if wanted else ():
            if channel.topic in wanted:
                yield channel.topic, 1e-9 * time_ns, self._message(channel, time_ns, data)

    def _message(self, channel: Channel, time_ns: int, data: bytes) -> Any:
        _, name, store = self._type_of(channel)
        try:
            decode = store.deserialize_ros1 if channel.encoding == "ros1" else store.deserialize_cdr
            message = decode(data, name)
        except Exception as error:
            raise FileError(
                f"a message of {channel.topic} at {1e-9 * time_ns:.3f} s is no {channel.type_name} "
                f"({reason_of(error)}). Record or export it again."
            ) from error
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        if stamp is not None and stamp.sec == stamp.nanosec == 0:
            stamp.sec, stamp.nanosec = divmod(time_ns, 10**9)
        return message

    def _type_of(self, channel: Channel) -> tuple[str | None, str, Any]:
        """Kind of a channel's messages, the name of their type and the store that decodes them."""
        key = (channel.type_name, channel.definition, channel.encoding)
        if key not in self._types:
            self._types[key] = _type(channel)
        return self._types[key]


def _type(channel: Channel) -> tuple[str | None, str, Any]:
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
    from rosbags.typesys.msg import normalize_msgtype

    if channel.encoding not in ("ros1", "cdr"):
        return None, channel.type_name, None
    name, store = normalize_msgtype(channel.type_name), get_typestore(Stores.EMPTY)
    if channel.definition:
        try:
            if channel.is_idl:
                types: dict[str, Any] = {}
                for text in channel.definition.split("=" * 80 + "\n"):
                    types |= get_types_from_idl(text.partition("\n")[2] if text.startswith("IDL:") else text)
            else:
                # Headers were of this package before 2010.
                types = get_types_from_msg(
                    channel.definition.replace("roslib/Header", "std_msgs/Header"), name
                )
            store.register(types)
            return _kind(name, types), name, store
        except Exception:
            pass  # ROS may have the type, and many topics are not needed
    standard = _STANDARD.get(name.rpartition("/")[2].lower())
    if standard is None:
        return None, name, None
    store = get_typestore(Stores.ROS1_NOETIC if channel.encoding == "ros1" else Stores.ROS2_HUMBLE)
    if standard not in store.types:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", standard))
    return standard.rpartition("/")[2], standard, store


def _kind(name: str, types: dict[str, Any]) -> str | None:
    """Kind of a type by the names of its fields; of scans, also by whether their ranges are numbers."""
    fields = {field.lower(): form for field, form in types[name][1]}
    if set(fields) == {"transforms"}:
        return TF
    for kind, needed in _FIELDS.items():
        if "header" in fields and needed <= set(fields):
            is_echoes = kind == SCAN and "float" not in str(fields["ranges"])
            return ECHOES if is_echoes else kind
    return None
