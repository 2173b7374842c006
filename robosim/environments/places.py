"""Buildings that robots of a process search in: each is built once, for all of them.

What is kept of a building is its walls for robots and rays, the places that a robot can reach, a simulator without a
robot of its own, and shortest drives to targets. The buildings used last are kept.
"""

from collections import OrderedDict
from functools import cached_property

import numpy as np
from jaxtyping import Float

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.drawing.picture import building_rings
from robosim.parts import CLASSIFIER
from robosim.plans.floorplan import FloorPlan
from robosim.radio.classifier import Classifier
from robosim.simulator import Simulator, SimulatorConfig
from robosim.support.parts import Part
from robosim.task.tasks import make_task

#: Buildings, those among them with a radio, whose tables take some 25 MB for each place of a transmitter, and drives in
#: each of them, that are kept.
_BUILDINGS, _WITH_RADIO, _DRIVES = 128, 32, 64
#: Targets of a pool are drawn from this, whatever the environment's seed: so tables of radio can be kept.
_POOL_SEED = 28


class Place:
    """A building with what is worked out for it."""

    def __init__(self, plan: FloorPlan, config: SimulatorConfig, *, uses_radio: bool) -> None:
        """Build it.

        Args:
            plan: Its floor plan.
            config: How robots are simulated in it.
            uses_radio: Whether they have a radio.
        """
        self.plan, self.config, self.uses_radio = plan, config, uses_radio
        self.building = make_building(plan)
        self.reach = reach(self.building, config.robot.radius_m, config.robot.height_m)
        self._simulator = Simulator(self.building, config, uses_radio=uses_radio)
        self._travel: OrderedDict[tuple[float, float], np.ndarray] = OrderedDict()
        self._classifier: tuple[Part, Classifier] | None = None
        self._pools: dict[int, np.ndarray] = {}

    @cached_property
    def rings(self) -> list[Float[np.ndarray, "_ 2"]]:
        """Outlines for pictures [m]."""
        return building_rings(self.building)

    def simulator(self) -> Simulator:
        """One for another robot."""
        return self._simulator.another()

    def classifier(self, part: Part) -> Classifier:
        """Who tells link states, one for all robots: what it makes of tables is kept with it."""
        if self._classifier is None or self._classifier[0] != part:
            self._classifier = part, CLASSIFIER.make(part, field="link_states")
        return self._classifier[1]

    def travel_m(self, target: Float[np.ndarray, "2"]) -> Float[np.ndarray, "ny nx"]:
        """`Reach.travel_m`, kept for targets that come again."""
        key = float(target[0]), float(target[1])
        if key not in self._travel:
            self._travel[key] = self.reach.travel_m(target)
            if len(self._travel) > _DRIVES:
                self._travel.popitem(last=False)
        self._travel.move_to_end(key)
        return self._travel[key]

    def pool(self, count: int) -> Float[np.ndarray, "count 2"]:
        """So many places for targets, the same ones in every process."""
        if count not in self._pools:
            rng = np.random.default_rng(_POOL_SEED)
            self._pools[count] = np.array([make_task(self.reach, rng).target for _ in range(count)])
        return self._pools[count]


_recent: list[Place] = []


def place_of(plan: FloorPlan, config: SimulatorConfig, *, uses_radio: bool) -> Place:
    """A building for a plan, a new one or one that is kept."""
    for place in reversed(_recent):
        # The plan itself, not its like: plans are large, and sources give the same object again.
        if place.plan is plan and place.config == config and place.uses_radio == uses_radio:
            _recent.remove(place)
            _recent.append(place)
            return place
    place = Place(plan, config, uses_radio=uses_radio)
    _recent.append(place)
    for old in [one for one in _recent if one.uses_radio][:-_WITH_RADIO] or _recent[:-_BUILDINGS]:
        _recent.remove(old)
    return place
