"""A team: robots in one world that report each other what they know."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from robosim.simulator import Simulator
from robosim.support.parts import Part
from robosim.team.exchange import Exchange
from robosim.team.member import Member, Status
from robosim.team.team_config import TeamConfig, robot_names
from robosim.team.team_radio import TeamRadio


class Team:
    """The robots of an episode, in the order in which they decide; a single one has no team."""

    def __init__(
        self,
        config: TeamConfig,
        robots: Mapping[str, Simulator],
        starts: Mapping[str, Float[np.ndarray, "3"]],
        classifier: Part,
        rng: np.random.Generator,
    ) -> None:
        """Make the members, for the robots' agents.

        Args:
            config: What they share.
            robots: The robots by name.
            starts: Pose of each at first: x [m], y [m], yaw [rad] in `map`.
            classifier: Of the states of links between robots.
            rng: Draws the noise of the radio between robots.
        """
        self._config, self._decision = config, -1
        self._in_order = dict(zip(robots, robot_names(len(robots)), strict=True))
        self.going = list(robots)
        """Names of the robots that were not lost."""
        self.members: dict[str, Member] = {}
        """Members by name; none of a single robot."""
        if len(robots) > 1:
            for order, (name, robot) in enumerate(robots.items()):
                member = Member(name, order, robot.config.robot.hull, config.every)
                if config.starts == "unknown":
                    member.begin_apart(starts[name], robot.config.radio)
                elif config.exchange != "none" and not robot.config.movers.any:
                    others = {
                        other: Status(
                            0, starts[other], starts[other][:2], world.config.robot.hull.turning_m, 0
                        )
                        for other, world in robots.items()
                        if other != name
                    }
                    member.begin_together(others)
                self.members[name] = member
        measures = config.exchange == "radio" or (config.exchange, config.starts) == ("perfect", "unknown")
        radio = TeamRadio(robots, classifier, rng) if measures and self.members else None
        self.exchange = Exchange(config, self.members, radio)

    def next_decision(self) -> list[str]:
        """Begin the next decision; names of the robots that take it, without those that were lost."""
        self._decision += 1
        self.going = [
            name for name in self.going if not self._config.is_lost(self._in_order[name], self._decision)
        ]
        self.exchange.begin(self._decision, self.going)
        return self.going

    def deliver(self, name: str) -> None:
        """Let a robot receive what reaches it from those that were not lost."""
        self.exchange.deliver(name, self.going)
