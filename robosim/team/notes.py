"""Notes: what robots tell each other, as bytes, so that nothing is shared by reference.

A note has an author, a topic and an edition; a later edition of a topic replaces an earlier one. Robots pass on the
notes of others, so that a robot in between connects two that do not hear each other.
"""

import pickle
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple


class Topic(NamedTuple):
    """Author and subject of a note."""

    author: str
    """Name of the robot that wrote it."""
    subject: str
    """What it is about: "status", "measurement" or "tile"."""
    number: tuple[int, ...] = ()
    """Which one of these."""


@dataclass(frozen=True)
class Note:
    """Something that a robot tells."""

    topic: Topic
    edition: int
    content: bytes

    @property
    def size(self) -> int:
        """Length with its header [bytes]."""
        return len(self.content) + _HEADER

    def read(self) -> Any:
        """Return the content as an object."""
        return pickle.loads(zlib.decompress(self.content))


#: Bytes of author, subject, number, edition and length.
_HEADER = 16


class Notebook:
    """The notes that a robot has written or heard, and those that each other robot has been sent."""

    def __init__(self, owner: str) -> None:
        self.owner = owner
        self._notes: dict[Topic, Note] = {}
        self._sent: dict[str, dict[Topic, int]] = {}

    def write(self, subject: str, content: Any, number: tuple[int, ...] = ()) -> None:
        """Write a note of one's own, or a later edition of it."""
        topic = Topic(self.owner, subject, number)
        before = self._notes.get(topic)
        packed = zlib.compress(pickle.dumps(content, protocol=5), 1)
        if before is None or before.content != packed:
            self._notes[topic] = Note(topic, 1 if before is None else before.edition + 1, packed)

    def hear(self, note: Note) -> bool:
        """Add the note of another robot; returns whether it is news."""
        before = self._notes.get(note.topic)
        if note.topic.author == self.owner or (before is not None and before.edition >= note.edition):
            return False
        self._notes[note.topic] = note
        return True

    def news_for(self, other: str, most_bytes: float) -> Iterator[Note]:
        """Notes that another robot was not sent yet, as many as fit, tiles last; each counts as sent once taken."""
        sent = self._sent.setdefault(other, {})
        news = [
            note
            for topic, note in self._notes.items()
            if topic.author != other and sent.get(topic, 0) < note.edition
        ]
        for note in sorted(news, key=lambda note: note.topic.subject):
            most_bytes -= note.size
            if most_bytes < 0:
                return
            sent[note.topic] = note.edition
            yield note
