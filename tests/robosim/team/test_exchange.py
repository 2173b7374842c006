"""Which notes of a team arrive, and when."""

from collections.abc import Callable, Collection

import numpy as np
import pytest

from robosim.team.exchange import Exchange
from robosim.team.member import Member
from robosim.team.team_config import TeamConfig
from robosim.team.team_radio import PairMeasurements, TeamRadio
from slam.hull import Hull

#: Bytes that a pair may send in a decision.
GRANTED = 100


class Radio(TeamRadio):
    """A radio whose rate grants `GRANTED` bytes a decision in the whole of the time."""

    def __init__(self) -> None:
        """No links are needed."""

    def measure(self, going: Collection[str]) -> Callable[[], PairMeasurements]:
        """Measure nothing."""
        return lambda: {"a": {}, "b": {}}

    def rate_bps(self, pair: tuple[str, str]) -> float:
        """The rate of any pair."""
        return 8.0 * GRANTED


@pytest.fixture
def exchange() -> tuple[Exchange, Member, Member]:
    first, second = (Member(name, k, Hull(radius_m=0.1), 10) for k, name in enumerate("ab"))
    config = TeamConfig(robots="2", airtime=1.0, every=10)
    return Exchange(config, {"a": first, "b": second}, Radio()), first, second


def _arrivals(exchange: Exchange, receiver: Member, subject: str, decisions: int) -> list[int]:
    """Notes of a subject from `a` that have arrived after each decision."""
    arrived = []
    for decision in range(decisions):
        exchange.begin(decision, ("a", "b"))
        exchange.deliver("b", ("a", "b"))
        arrived.append(sum(note.topic.subject == subject for note in receiver.notes.of("a")))
    return arrived


def test_a_note_of_several_decisions_arrives_when_all_of_it_was_sent(
    exchange: tuple[Exchange, Member, Member],
) -> None:
    between, author, reader = exchange
    for k in range(2):
        author.notes.write("tile", np.random.default_rng(k).bytes(900), (k,))
    sizes = [note.size for note in author.notes.of("a")]
    arrived = _arrivals(between, reader, "tile", 31)
    # Tiles are sent at each tenth decision, after 1, 11 and 21 shares of the time.
    assert [arrived[k] for k in (0, 9, 10, 19, 20, 30)] == [0, 0, 1, 1, 2, 2]
    assert between.sent_bytes["a"] == sum(sizes) <= 21 * GRANTED


def test_time_that_was_not_used_is_lost(exchange: tuple[Exchange, Member, Member]) -> None:
    between, author, reader = exchange
    assert _arrivals(between, reader, "status", 30)[-1] == 0
    author.notes.write("status", np.random.default_rng(0).bytes(2 * GRANTED))
    between.begin(31, ("a", "b"))
    between.deliver("b", ("a", "b"))
    assert not reader.notes.of("a")
