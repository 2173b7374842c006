"""Watch a search: choose a policy and its task, let it run, and drive against it by hand."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from robosim.building.building import BuildingConfig
from robosim.episode import EpisodeConfig
from robosim.evaluation.ablations import POLICY, configured
from robosim.live.player import Player
from robosim.live.radio_panel import RadioPanel
from robosim.live.search_process import BY_HAND, GO, WAIT, SearchJob, SearchProcess
from robosim.live.task_picker import TaskPicker
from slam.actions import Action

if TYPE_CHECKING:
    import viser

ROOT = "/search"
START, END = "Start", "End it"
#: What stands beside the policies: none to compare with, and a person who drives.
NOBODY, BY_HAND_NAME = "nothing", "yourself, by arrow keys"
#: Where a task comes from.
FROM_SEED, FROM_HANDLES = "drawn from the seed", "robot to transmitter, as in Radio"
FROM_CLICKS = "as clicked; the rest from the seed"
#: The page turns its view by arrow keys too; the letters drive and leave it as it is.
_KEYS: tuple[tuple[Any, Action, str], ...] = (
    ("arrowup", Action.FORWARD, "forward"),
    ("arrowdown", Action.BACKWARD, "back"),
    ("arrowleft", Action.LEFT, "left"),
    ("arrowright", Action.RIGHT, "right"),
    ("I", Action.FORWARD, "forward (I)"),
    ("K", Action.BACKWARD, "back (K)"),
    ("J", Action.LEFT, "left (J)"),
    ("L", Action.RIGHT, "right (L)"),
)


class SearchPanel:
    """The part `Search` of the panel."""

    def __init__(
        self,
        server: "viser.ViserServer",
        radio: RadioPanel,
        config: EpisodeConfig,
        building: BuildingConfig,
        *,
        on_view: Callable[[], None],
    ) -> None:
        """Fill the current part of the panel.

        Args:
            server: The page.
            radio: Gives the plan, and tasks that are set by hand.
            config: How episodes are run, but for what is asked for here.
            building: How plans become buildings.
            on_view: Called when another search is drawn.
        """
        self._radio, self._config, self._building, self._on_view = radio, config, building, on_view
        self._server = server
        self.searches: list[SearchProcess] = []
        self._loaded = False
        self._fill(server.gui)
        self.player = Player(server, ROOT, on_play=self._let_go, on_step=self._step, on_speed=self._pace)

    def close(self) -> None:
        """End what runs."""
        self._end()
        self.player.close()

    def start(self) -> None:
        """Start what is chosen, in place of what runs."""
        self._end()
        self.player.clear()
        self._loaded = False
        try:
            jobs = self._jobs()
        except ValueError as error:
            self.player.say(str(error), bad=True)
            return
        self.player.say("Getting ready: the robot, its map and its radio take some seconds ...")
        self.searches = [SearchProcess(title, job, self._told, mode) for title, job, mode in jobs]
        self._pace(self.player.per_s)

    def stop(self) -> None:
        """End what runs; what was recorded stays."""
        self._end()
        self.player.update()

    def _fill(self, gui: Any) -> None:
        with gui.add_folder("What is searched"):
            names = tuple(dict.fromkeys((str(self._config.goal), *POLICY.names)))
            self._policy = gui.add_dropdown("policy", (*names, BY_HAND_NAME), initial_value=names[0])
            self._other = gui.add_dropdown("beside it", (NOBODY, *names, BY_HAND_NAME), initial_value=NOBODY)
            tasks = (FROM_SEED, FROM_HANDLES, FROM_CLICKS)
            self._task = gui.add_dropdown("task", tasks, initial_value=FROM_SEED)
            self.picker = TaskPicker(
                self._server,
                nearest_free=lambda at: self._radio.model.nearest_free(at),
                sceneries=lambda: self.player.sceneries or [self._radio.scenery],
                say=lambda text: self.player.say(text),
                on_change=self._picked,
            )
            self._seed = gui.add_number("seed", self._config.seed, min=0, max=2**31 - 1, step=1)
            noise = self._config.simulator.noise.level
            self._noise = gui.add_slider("noise [times published]", 0.0, max(3.0, noise), 0.25, noise)
        buttons = gui.add_button_group("search", (START, END))
        buttons.on_click(lambda event: self.start() if buttons.value == START else self.stop())
        for key, action, word in _KEYS:
            command = gui.add_command(
                f"Drive {word}", description="when you drive yourself", hotkey=key, modifier=None
            )
            command.on_trigger(self._presser(action))

    def _picked(self) -> None:
        """A place was set by a click, or both were forgotten."""
        self._task.value = FROM_CLICKS if self.picker.places else FROM_SEED

    def _presser(self, action: Action) -> Callable[[Any], None]:
        def press(event: Any) -> None:
            for search in self.searches:
                search.press(action)

        return press

    def _jobs(self) -> list[tuple[str, SearchJob, int]]:
        config = self._config
        simulator = config.simulator
        radio = self._radio.model
        config = replace(
            config,
            seed=int(self._seed.value),
            building=replace(
                self._building,
                wall_material=radio.settings.wall_material,
                furniture_material=radio.settings.wall_material,
            ),
            simulator=replace(
                simulator,
                noise=replace(simulator.noise, level=float(self._noise.value)),
                radio=replace(
                    simulator.radio,
                    frequency_hz=radio.settings.frequency_hz,
                    height_m=radio.settings.height_m,
                    tracer=radio.settings.tracer,
                ),
            ),
        )
        start, target = self._given()
        chosen = [self._policy.value] + ([self._other.value] if self._other.value != NOBODY else [])
        jobs = []
        for name in chosen:
            by_hand = name == BY_HAND_NAME
            own = configured(config, self._config.goal if by_hand else name)
            title = "you" if by_hand else str(name)
            jobs.append(
                (
                    title,
                    SearchJob(plan=radio.building.plan, config=own, start=start, target=target),
                    BY_HAND if by_hand else GO,
                )
            )
        return jobs

    def _given(self) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Pose of the robot at first, and place of the target, where they are set by hand; it looks to the target."""
        at = target = None
        if self._task.value == FROM_HANDLES:
            at, target = (self._radio.places[who] for who in ("robot", "transmitter"))
        elif self._task.value == FROM_CLICKS:
            # Where there is a wall now, if another plan was opened since.
            set_to = {what: self._radio.model.nearest_free(at) for what, at in self.picker.places.items()}
            at, target = (set_to.get(what) for what in ("start", "target"))
        if at is None:
            return None, target
        x, y = (1.0, 0.0) if target is None else target - at
        return np.array([*at, math.atan2(y, x)]), target

    def _told(self, search: SearchProcess) -> None:
        """A search has begun, decided something, or ended."""
        if search not in self.searches:
            return
        if search.trouble:
            self.player.say(f"{search.title}: {search.trouble}", bad=True)
        recordings = [one.recording for one in self.searches]
        if not self._loaded and all(recording is not None for recording in recordings):
            self._loaded = True
            self.player.load([r for r in recordings if r is not None], playing=True, following=True)
            by_hand = any(one.title == "you" for one in self.searches)
            self.player.say(
                "Drive by the arrow keys, or by I, J, K and L, which leave the view as it is."
                if by_hand
                else ""
            )
            self._on_view()
        self.player.update()

    def _let_go(self, playing: bool) -> None:
        for search in self.searches:
            if search.title != "you":
                search.set_mode(GO if playing else WAIT)

    def _step(self) -> None:
        for search in self.searches:
            search.step()

    def _pace(self, per_s: float) -> None:
        for search in self.searches:
            search.set_pause(0.0 if math.isinf(per_s) else 1 / per_s)

    def _end(self) -> None:
        ended, self.searches = self.searches, []
        for search in ended:
            # Before its process is gone, or it would take it for an end from outside.
            if search.recording is not None and not search.recording.ended:
                search.recording.ended = "ended by you"
            search.close()
