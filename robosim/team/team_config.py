"""Configuration of a team."""

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from robosim.support.checks import ADVANCED, Range, checked

#: How robots of a team exchange what they know.
ExchangeName = Literal["perfect", "radio", "none"]
#: What robots of a team know of each other's starts.
StartsName = Literal["known", "unknown"]


#: Most robots of a team.
MOST = 100


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
    directions and distances that robots measure of each other give the relative pose."""
    lose: Annotated[tuple[str, ...], ADVANCED] = ()
    """Robots that stop during the search, and when: 2@100 is the second robot at decision 100."""

    def __post_init__(self) -> None:
        if self.robots.isdigit() and not 1 <= int(self.robots) <= MOST:
            raise ValueError(f"robots is {self.robots}, expected 1 to {MOST}, or names of robots.")
        if not all(name.strip() for name in self.robots.split(",")):
            raise ValueError(
                f"robots is {self.robots!r}, expected a number, or names separated by commas, such as "
                "jackal,turtlebot4."
            )
        for text in self.lose:
            number, at, decision = text.partition("@")
            if not (at and number.isdigit() and decision.isdigit() and 1 <= int(number) <= self.size):
                raise ValueError(
                    f"team.lose is {text!r}, expected the number of a robot, 1 to {self.size}, and a decision, such as "
                    "1@100."
                )

    @property
    def size(self) -> int:
        """Number of robots."""
        return int(self.robots) if self.robots.isdigit() else len(self.models)

    @property
    def models(self) -> tuple[str, ...]:
        """Names of the robots' models; none if all are alike."""
        return () if self.robots.isdigit() else tuple(name.strip() for name in self.robots.split(","))

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
