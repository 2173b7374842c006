"""Configuration of a team."""

import re
from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from robosim.support.checks import ADVANCED, Range, checked, shown

#: How robots of a team exchange what they know.
ExchangeName = Literal["perfect", "radio", "none"]
#: What robots of a team know of each other's starts.
StartsName = Literal["known", "unknown"]


#: Most robots of a team.
MOST = 100
#: A number of robots, and when which of them stops.
_NUMBER, _LOSS = re.compile(r"[0-9]{1,9}"), re.compile(r"[0-9]{1,9}@[1-9][0-9]{0,8}")


@dataclass(frozen=True, kw_only=True)
@checked
class TeamConfig:
    """How many robots there are, and how they share what they know."""

    robots: Annotated[str, tyro.conf.arg(prefix_name=False)] = "1"
    """Robots that search together: their number, all like --robot, or their names, such as jackal,turtlebot4."""
    exchange: ExchangeName = "radio"
    """How robots exchange maps, measurements and plans: by their radio, as far as it reaches; perfect: all of it at
    once; none: each searches for itself."""
    airtime: Annotated[float, Range(0, 1), ADVANCED] = 0.05
    """Share of the time in which one robot may send to another."""
    every: Annotated[int, Range(1, 1_000_000, "decisions"), ADVANCED] = 10
    """Decisions between two measurements of the radio between robots, and between two exchanges of maps."""
    starts: StartsName = "known"
    """Whether robots know where the others start. If not, each has a frame of its own, and maps stay apart until
    directions and distances that robots measure of each other, or places on both maps, give the relative pose."""
    lose: Annotated[tuple[str, ...], ADVANCED] = ()
    """Robots that stop during the search, and when: 2@100 is the second robot at decision 100."""

    def __post_init__(self) -> None:
        is_text = isinstance(self.robots, str)
        if not (is_text and all(self.models) and (2 if self.models else 1) <= self.size <= MOST):
            raise ValueError(
                f"robots is {shown(self.robots)}, expected 1 to {MOST}, or 2 to {MOST} names, such as "
                "jackal,turtlebot4. One robot is --robot jackal."
            )
        for text in self.lose:
            is_loss = _LOSS.fullmatch(str(text)) and self.size > 1
            if not (is_loss and 1 <= int(text.partition("@")[0]) <= self.size):
                raise ValueError(
                    f"team.lose is {shown(text)}, expected the number of a robot of a team, 1 to {self.size}, and a "
                    "decision from 1 on, such as 1@100 with --robots 2."
                )
        if len({int(text.partition("@")[0]) for text in self.lose}) < len(self.lose):
            raise ValueError(f"team.lose is {' '.join(self.lose)}, expected each robot once.")

    @property
    def size(self) -> int:
        """Number of robots."""
        return len(self.models) or int(self.robots)

    @property
    def models(self) -> tuple[str, ...]:
        """Names of the robots' models; none if all are alike."""
        return (
            () if _NUMBER.fullmatch(self.robots) else tuple(name.strip() for name in self.robots.split(","))
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the robots."""
        return robot_names(self.size)

    def is_lost(self, name: str, decision: int) -> bool:
        """Whether a robot has stopped permanently before a decision."""
        lost = (text.partition("@") for text in self.lose)
        return any(self.names[int(number) - 1] == name and decision >= int(when) for number, _, when in lost)


def robot_names(count: int) -> tuple[str, ...]:
    """Names of the robots of a team: robot1, robot2 and so on."""
    return tuple(f"robot{number}" for number in range(1, count + 1))
