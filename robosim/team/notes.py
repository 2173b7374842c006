"""Notes: what robots exchange, as bytes, so that nothing is shared by reference.

A note has an author, a topic and an edition; a later edition of a topic replaces an earlier one. Robots pass on the
notes of others, so that a robot in between connects two that do not receive each other. Two robots that exchange notes
compare their editions first, so that nothing is sent twice.
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
    """Subject, one of `SUBJECTS`."""
    number: tuple[int, ...] = ()
    """Which one of these."""


@dataclass(frozen=True)
class Note:
    """Something that a robot reports."""

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
#: Subjects of notes, in the order in which they are sent.
SUBJECTS = ("status", "robots", "measurement", "tile", "submaps")


class Notebook:
    """The notes that a robot has written or received."""

    def __init__(self, owner: str) -> None:
        self.owner = owner
        self._notes: dict[str, dict[Topic, Note]] = {subject: {} for subject in SUBJECTS}

    def write(self, subject: str, content: Any, number: tuple[int, ...] = ()) -> None:
        """Write a note of one's own, or a later edition of it."""
        topic = Topic(self.owner, subject, number)
        packed = zlib.compress(pickle.dumps(content, protocol=5), 1)
        self._notes[subject][topic] = Note(topic, self.edition(topic) + 1, packed)

    def receive(self, note: Note) -> None:
        """Add the note of another robot."""
        self._notes[note.topic.subject][note.topic] = note

    def edition(self, topic: Topic) -> int:
        """Number of the edition that the robot has; 0 without one."""
        note = self._notes[topic.subject].get(topic)
        return 0 if note is None else note.edition

    def of(self, author: str) -> list[Note]:
        """All notes of a robot."""
        return [
            note for notes in self._notes.values() for topic, note in notes.items() if topic.author == author
        ]

    def news_for(self, other: "Notebook", subject: str) -> Iterator[Note]:
        """Notes of which another robot has no edition, or an earlier one."""
        for topic, note in self._notes[subject].items():
            if topic.author != other.owner and other.edition(topic) < note.edition:
                yield note
