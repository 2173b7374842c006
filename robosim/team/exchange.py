"""Exchange: which notes arrive, and when.

By radio, each pair of robots has a link through the building, with the arrays that they receive the target with at both
ends. Its rate is that of Shannon for the signal-to-noise ratio of all paths together, over the bandwidth, for the share
of the time that a pair is given. Statuses, and which robots are in sight, are sent at each decision; measurements,
tiles and submaps less often. A note that does not fit is sent over several decisions, and those behind it wait.

Left out: interference between pairs, retransmissions.
"""

import math
from collections.abc import Collection, Mapping
from itertools import combinations, product

from robosim.team.member import Member
from robosim.team.notes import SUBJECTS
from robosim.team.team_config import TeamConfig
from robosim.team.team_radio import TeamRadio

#: Time of a decision [s].
_DECISION_S = 1.0
#: Decisions between two measurements of the radio between robots whose relative starts are unknown.
_LOOKS = 3


class Exchange:
    """Delivers the notes of a team."""

    def __init__(self, config: TeamConfig, members: Mapping[str, Member], radio: TeamRadio | None) -> None:
        self._config, self._members, self._radio = config, members, radio
        pairs = combinations(members, 2)
        self._bytes_left = dict.fromkeys(pairs, math.inf if config.exchange == "perfect" else 0.0)
        self._waiting: set[tuple[str, str]] = set()
        """Pairs with a note that did not fit when all subjects were last sent."""
        self._subjects: tuple[str, ...] = SUBJECTS
        self.sent_bytes = dict.fromkeys(members, 0)
        """Bytes that each robot has sent."""

    def begin(self, decision: int, going: Collection[str]) -> None:
        """Grant each pair the time of another decision; the radio is measured occasionally, for starts more often.

        Args:
            decision: Its number.
            going: Names of the robots that were not lost.
        """
        is_occasion = decision % self._config.every == 0
        self._subjects = SUBJECTS if is_occasion else SUBJECTS[:2]
        if self._radio is None:
            return
        if is_occasion or (self._config.starts == "unknown" and decision % _LOOKS == 0):
            received = self._radio.measure(going)
            for member in self._members.values():
                member.measured(received)
        if self._config.exchange == "perfect":
            return
        for pair, left in self._bytes_left.items():
            # Time that was not used is lost, unless a part of a note was sent in it.
            carried = left if pair in self._waiting else 0.0
            granted = self._radio.rate_bps(pair) * self._config.airtime * _DECISION_S / 8
            self._bytes_left[pair] = carried + granted
        if is_occasion:
            self._waiting.clear()

    def deliver(self, receiver: str, going: Collection[str]) -> None:
        """Give a robot the notes of those that are going which reach it now."""
        for subject, pair in product(self._subjects, self._bytes_left):
            sender = pair[0] if pair[1] == receiver else pair[1]
            if receiver not in pair or sender not in going:
                continue
            received = self._members[receiver].notes
            for note in self._members[sender].notes.news_for(received, subject):
                if note.size > self._bytes_left[pair]:
                    self._waiting.add(pair)
                    break
                self._bytes_left[pair] -= note.size
                self.sent_bytes[sender] += note.size
                self._members[receiver].receive(note)
