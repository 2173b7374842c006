"""The tab `Search`: choose policies and a task, run searches, and drive by hand."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float

from robosim.episode_config import EpisodeConfig
from robosim.live.player import Player
from robosim.live.radio_panel import RadioPanel
from robosim.live.radio_view import intersect_level
from robosim.live.scene_nodes import NO_SHADOW, ROBOT_COLOUR, TX_COLOUR
from robosim.live.search_process import MANUAL, RUN, WAIT, SearchJob, SearchProcess
from robosim.parts import GOAL
from slam.actions import Action

if TYPE_CHECKING:
    import viser

ROOT = "/search"
START, STOP = "Start", "Stop"
#: Options next to the policies: no second search, and a person who drives.
NONE, BY_HAND = "none", "manual control"
#: Title of a search that a person drives.
_MANUAL_TITLE = "manual"
#: Sources of a task.
FROM_SEED, FROM_HANDLES = "drawn from the seed", "robot to transmitter, as in Radio"
FROM_CLICKS = "as clicked; the rest from the seed"
#: Buttons of the task.
SET_START, SET_TARGET, CLEAR = "set start", "set target", "clear"
#: The arrow keys turn the view of the page, too; the letters do not.
_KEYS: tuple[tuple[Any, Action, str], ...] = (
    ("arrowup", Action.FORWARD, "forward"),
    ("arrowdown", Action.BACKWARD, "back"),
    ("arrowleft", Action.LEFT, "left"),
    ("arrowright", Action.RIGHT, "right"),
    ("I", Action.FORWARD, "forward (I)"),
    ("K", Action.BACKWARD, "back (K)"),
    ("J", Action.LEFT, "left (J)"),
    ("L", Action.RIGHT, "right (L)"),
    ("H", Action.WAIT, "wait (H)"),
)
#: Radius and height of the marks of start and target [m].
_MARK_M, _MARK_HEIGHT_M = 0.16, 0.3
End = Literal["start", "target"]


class SearchPanel:
    """The controls of the tab `Search`, and its searches."""

    def __init__(
        self,
        server: "viser.ViserServer",
        radio: RadioPanel,
        config: EpisodeConfig,
        *,
        on_view: Callable[[], None],
    ) -> None:
        """Fill the current part of the panel; `config` holds defaults of the controls and all other settings.

        `on_view` is called when other searches are drawn.
        """
        self._server, self._radio, self._config, self._on_view = server, radio, config, on_view
        self.searches: list[SearchProcess] = []
        self._is_loaded = False
        self.places: dict[End, Float[np.ndarray, 2]] = {}
        """Start and target that are set by clicks on the floor [m]."""
        self._pending: End | None = None
        self._marks: dict[End, Any] = {}
        self._shows_marks = True
        self._fill(server.gui)
        self.player = Player(
            server, ROOT, on_play=self._set_running, on_step=self._step, on_speed=self._set_speed
        )

    def close(self) -> None:
        """End everything."""
        self._end()
        self.player.close()

    def start(self) -> None:
        """Start the chosen searches instead of those that run."""
        self._end()
        self.player.clear()
        self._is_loaded = False
        try:
            jobs = self._jobs()
        except ValueError as error:
            self.player.say(str(error), bad=True)
            return
        self.player.say("Preparing robot, map and radio, which takes some seconds ...")
        self.searches = [SearchProcess(title, job, self._update, mode) for title, job, mode in jobs]
        self._set_speed(self.player.per_s)

    def stop(self) -> None:
        """Stop the searches; their recordings stay."""
        self._end()
        self.player.update()

    def await_click(self, end: End) -> None:
        """Use the next click on the floor for a place."""
        if self._pending is None:
            self._server.scene.on_click()(self._click)
        self._pending = end
        self.player.say(f"Click on the floor at the {'start of the robot' if end == 'start' else 'target'}.")

    def set_place(self, end: End, place: Float[np.ndarray, "2"]) -> None:
        """Set and mark the free place nearest to a point [m]."""
        x, y = self.places[end] = self._radio.model.nearest_free(place)
        position, scene = (float(x), float(y), _MARK_HEIGHT_M), self._server.scene
        if end in self._marks:
            self._marks[end].position = position
        else:
            colour, name = ROBOT_COLOUR if end == "start" else TX_COLOUR, f"/task/{end}"
            self._marks[end] = scene.add_icosphere(
                name, radius=_MARK_M, color=colour, position=position, visible=self._shows_marks, **NO_SHADOW
            )
            scene.add_label(f"{name}/name", f"{end}, as set", position=(0, 0, 0.2), anchor="bottom-center")
        self.player.say("")
        self._task.value = FROM_CLICKS

    def clear_places(self) -> None:
        """Remove start and target."""
        for mark in self._marks.values():
            mark.remove()
        self.places.clear()
        self._marks.clear()
        self.player.say("")
        self._task.value = FROM_SEED

    def show_marks(self, visible: bool) -> None:
        """Show or hide the marks of start and target."""
        self._shows_marks = visible
        for mark in self._marks.values():
            mark.visible = visible

    def _click(self, event: Any) -> None:
        end, self._pending = self._pending, None
        self._server.scene.remove_click_callback(self._click)
        origin = np.array(event.ray_origin)
        place = intersect_level(origin, origin + np.array(event.ray_direction), 0.0)
        if end is not None and place is not None:
            # The nearest of buildings side by side was clicked.
            buildings = self.player.buildings or [self._radio.building]
            nearest = min(buildings, key=lambda building: float(np.hypot(*(building.middle - place))))
            self.set_place(end, place - nearest.offset)

    def _fill(self, gui: "viser.GuiApi") -> None:
        with gui.add_folder("Task"):
            names = tuple(dict.fromkeys((str(self._config.goal), *GOAL.names)))
            self._policy = gui.add_dropdown("policy", (*names, BY_HAND), initial_value=names[0])
            self._other = gui.add_dropdown("compared with", (NONE, *names, BY_HAND), initial_value=NONE)
            tasks = (FROM_SEED, FROM_HANDLES, FROM_CLICKS)
            self._task: Any = gui.add_dropdown("start and target", tasks, initial_value=FROM_SEED)
            clicks = gui.add_button_group("by clicks on the floor", (SET_START, SET_TARGET, CLEAR))
            self._seed = gui.add_number("seed", self._config.seed, min=0, max=2**31 - 1, step=1)
            people = self._config.simulator.movers.people
            self._people = gui.add_number("people", people, min=0, max=max(50, people), step=1)
            self._team = gui.add_text("robots", self._config.team.robots)
            noise = self._config.simulator.robot.noise.level
            self._noise = gui.add_slider("noise [times published]", 0.0, max(3.0, noise), 0.25, noise)
        actions = {
            SET_START: lambda: self.await_click("start"),
            SET_TARGET: lambda: self.await_click("target"),
            CLEAR: self.clear_places,
        }
        clicks.on_click(lambda event: actions[clicks.value]())
        buttons = gui.add_button_group("search", (START, STOP))
        buttons.on_click(lambda event: self.start() if buttons.value == START else self.stop())
        for key, action, label in _KEYS:
            command = gui.add_command(f"Drive {label}", description=BY_HAND, hotkey=key, modifier=None)
            command.on_trigger(partial(self._press, action))

    def _press(self, action: Action, _: Any) -> None:
        for search in self.searches:
            search.press(action)

    def _jobs(self) -> list[tuple[str, SearchJob, int]]:
        """Title, job and mode of each search."""
        radio, simulator = self._radio.model.config, self._config.simulator
        robot = simulator.robot
        config = replace(
            self._config,
            seed=int(self._seed.value),
            team=replace(self._config.team, robots=self._team.value.strip()),
            building=replace(radio.building, furniture_material=radio.building.wall_material),
            simulator=replace(
                simulator,
                robot=replace(robot, noise=replace(robot.noise, level=float(self._noise.value))),
                movers=replace(simulator.movers, people=int(self._people.value)),
                radio=replace(
                    simulator.radio,
                    frequency_hz=radio.frequency_hz,
                    height_m=radio.height_m,
                    tracer=radio.tracer,
                ),
            ),
        )
        start, target = self._ends()
        plan = self._radio.model.building.plan
        jobs = []
        for name in (self._policy.value, self._other.value):
            if name == NONE:
                continue
            is_manual = name == BY_HAND
            search_config = replace(config, goal=self._config.goal if is_manual else name)
            job = SearchJob(plan=plan, config=search_config, start=start, target=target)
            jobs.append((_MANUAL_TITLE, job, MANUAL) if is_manual else (str(name), job, RUN))
        return jobs

    def _ends(self) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Start pose, facing the target, and position of the target, where they are not drawn from the seed."""
        place = target = None
        if self._task.value == FROM_HANDLES:
            place, target = self._radio.places["robot"], self._radio.places["transmitter"]
        elif self._task.value == FROM_CLICKS:
            # Another plan may have been opened since the click.
            free = {end: self._radio.model.nearest_free(at) for end, at in self.places.items()}
            place, target = free.get("start"), free.get("target")
        if place is None:
            return None, target
        x, y = (1.0, 0.0) if target is None else target - place
        return np.array([*place, math.atan2(y, x)]), target

    def _update(self, search: SearchProcess) -> None:
        """Show a search that has begun, has made a step, or has ended."""
        if search not in self.searches:
            return
        if search.error:
            self.player.say(f"{search.title}: {search.error}", bad=True)
        recordings = [search.recording for search in self.searches if search.recording is not None]
        if not self._is_loaded and len(recordings) == len(self.searches):
            self._is_loaded = True
            self.player.load(recordings, playing=True, following=True)
            is_manual = any(search.title == _MANUAL_TITLE for search in self.searches)
            self.player.say("Drive with the arrow keys, or with I, J, K and L." if is_manual else "")
            self._on_view()
        self.player.update()

    def _set_running(self, playing: bool) -> None:
        for search in self.searches:
            if search.title != _MANUAL_TITLE:
                search.set_mode(RUN if playing else WAIT)

    def _step(self) -> None:
        for search in self.searches:
            search.step()

    def _set_speed(self, per_s: float) -> None:
        for search in self.searches:
            search.set_pause(0.0 if math.isinf(per_s) else 1 / per_s)

    def _end(self) -> None:
        ended, self.searches = self.searches, []
        for search in ended:
            # Set before the process is killed, which is recorded as another end.
            if search.recording is not None and not search.recording.ended:
                search.recording.ended = "stopped by you"
            search.close()
