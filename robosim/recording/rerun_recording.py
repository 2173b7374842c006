"""An episode for the Rerun viewer: all data of all steps, on one time line, in 3D.

    world/walls, world/target        once
    world/camera                     RGB and depth where the camera truly is
    world/true, world/estimated      the robot, at its true and at its estimated pose
    world/built, anticipated, belief the map, the anticipated map, and the belief
    world/goal, world/path           goal of the robot, and its path
    world/rays                       true radio paths, by kind
    world/arrivals                   estimated angles of arrival
    link/..., belief/..., pose/...   time lines of link state, SNR, belief and pose error

Needs the extra `viz`. The file takes its name when it is closed.
"""

import math
import os
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from robosim.building.building import Building
from robosim.camera.model import CameraConfig, camera_pose
from robosim.drawing.picture import arrow_length_m
from robosim.drawing.plan_view import (
    ESTIMATE_ORANGE,
    PALETTE,
    PATH_PURPLE,
    TARGET_RED,
    TRUE_GREEN,
    WALL_BLUE,
    building_rings,
)
from robosim.layers import TOP_LEVEL, Belief, Layer
from robosim.radio.measurement import Measurement
from robosim.step import Step
from robosim.support.colours import STATE_COLOURS
from robosim.support.files import partial_path
from robosim.support.installation import install_command
from robosim.task.tasks import Task
from slam.grid import GridFrame, MapEstimate
from wireless.paths import Interaction, LinkCategory, LinkState, Paths

RECORDING = "episode.rrd"
#: Colours of traced paths by their interactions: none, else the most informative kind.
RAY_COLOURS = {
    "line of sight": STATE_COLOURS[LinkState.LOS],
    "reflection": STATE_COLOURS[LinkState.FIRST_ORDER],
    "diffraction": (204, 121, 167),
    "reflection and diffraction": (230, 159, 0),
    "transmission": STATE_COLOURS[LinkCategory.OBSTRUCTED_LOS],
    "scattering": (213, 94, 0),
}


class RerunRecording:
    """A recording of one episode."""

    def __init__(
        self, path: Path, building: Building, task: Task, camera: CameraConfig, radio_height_m: float
    ) -> None:
        """Open the file and record what does not change; ValueError if the Rerun SDK is not installed."""
        rr = self._rr = rerun_sdk()
        self.path, self._camera, self._radio_m = Path(path), camera, radio_height_m
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._partial = partial_path(self.path)
        self._to = rr.RecordingStream("robosim")
        self._to.save(self._partial, default_blueprint=_layout())
        self._log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        rings = [_raised(ring, 0.0) for ring in building_rings(building)]
        self._log("world/walls", rr.LineStrips3D(rings, colors=[WALL_BLUE]), static=True)
        target = [[*task.target, radio_height_m]]
        self._log("world/target", rr.Points3D(target, radii=0.12, colors=[TARGET_RED]), static=True)
        lens = rr.Pinhole(image_from_camera=camera.K, resolution=[camera.width, camera.height])
        self._log("world/camera", lens, static=True)

    def add(self, step: Step) -> None:
        """Record a step."""
        self._to.set_time("decision", sequence=step.number)
        self._add_robot(step)
        self._add_maps(step.estimated.map, step.map_layer)
        self._add_plan(step)
        if step.true.paths is not None:
            self._add_rays(step.true.paths)
        if step.estimated.measurement is not None and step.true.link_state is not None:
            self._add_measurement(step.estimated.measurement, step.true.link_state)
        if step.decided.belief is not None and step.belief_layer is not None:
            self._grid("world/belief", step.belief_layer.frame, _tinted(step.belief_layer), 3.0)
            self._log("belief/mass_at_peak", self._rr.Scalars(_mass_at_peak(step.decided.belief)))

    def close(self) -> None:
        """Finish the file, and give it its name."""
        self._to.flush()
        self._to.disconnect()
        os.replace(self._partial, self.path)

    def _log(self, entity: str, what: Any, **options: Any) -> None:
        self._to.log(entity, what, **options)

    def _add_robot(self, step: Step) -> None:
        rr, pose, estimate = self._rr, step.true.pose, step.estimated.pose
        place = camera_pose(pose, self._camera)
        self._log("world/camera", rr.Transform3D(translation=place[:3, 3], mat3x3=place[:3, :3]))
        self._log("world/camera/rgb", rr.Image(step.sensed.rgb))
        self._log("world/camera/depth", rr.DepthImage(step.sensed.depth, meter=1.0))
        for name, at, colour in (("true", pose, TRUE_GREEN), ("estimated", estimate, ESTIMATE_ORANGE)):
            ahead = [[0.3 * np.cos(at[2]), 0.3 * np.sin(at[2]), 0.0]]
            arrow = rr.Arrows3D(vectors=ahead, origins=[[*at[:2], 0.1]], colors=[colour], radii=0.04)
            self._log(f"world/{name}", arrow)
        self._log("pose/position_error_m", rr.Scalars(step.position_error_m))
        self._log("pose/heading_error_deg", rr.Scalars(math.degrees(step.heading_error_rad)))

    def _add_maps(self, estimate: MapEstimate, built: Layer) -> None:
        opaque = np.full((*built.values.shape, 1), 255, np.uint8)
        self._grid(
            "world/built", built.frame, np.concatenate([PALETTE[built.values, 0], opaque], axis=-1), 1.0
        )
        if estimate.anticipated_probability is not None:
            guess = (255 * estimate.anticipated_probability).astype(np.uint8)
            dark = np.zeros((*guess.shape, 3), np.uint8)
            self._grid("world/anticipated", estimate.frame, np.dstack([dark, guess // 2]), 2.0)

    def _add_plan(self, step: Step) -> None:
        rr = self._rr
        goal = [[*step.decided.goal, 0.05]]
        self._log("world/goal", rr.Points3D(goal, radii=0.08, colors=[PATH_PURPLE]))
        strip = rr.LineStrips3D([_raised(step.decided.path, 0.05)], colors=[PATH_PURPLE], radii=0.02)
        self._log("world/path", strip)

    def _add_rays(self, paths: Paths) -> None:
        kinds = [ray_kind(row) for row in paths.interaction]
        strips = rays(paths)
        colours = [RAY_COLOURS[kind] for kind in kinds]
        self._log(
            "world/rays", self._rr.LineStrips3D(strips, colors=colours, labels=kinds, show_labels=False)
        )

    def _add_measurement(self, measurement: Measurement, true_state: LinkState) -> None:
        rr = self._rr
        vectors = [
            arrow_length_m(measurement, i)
            * np.array([np.cos(measurement.aoa_rad[i]), np.sin(measurement.aoa_rad[i]), 0.0])
            for i in measurement.directed.tolist()
        ]
        origins = np.tile([*measurement.pose[:2], self._radio_m], (len(vectors), 1))
        colours = np.tile(STATE_COLOURS[measurement.state], (len(vectors), 1))
        arrows = rr.Arrows3D(
            vectors=np.reshape(vectors, (-1, 3)), origins=origins, colors=colours, radii=0.02
        )
        self._log("world/arrivals", arrows)
        for name, state in (("believed_state", measurement.state), ("true_state", true_state)):
            self._log(f"link/{name}", rr.StateChange(state=_words(state)))
        for state in LinkState:
            self._log(
                f"link/probability/{state.name.lower()}", rr.Scalars(float(measurement.probability[state]))
            )
        if len(measurement.snr_db):
            self._log("link/snr_db", rr.Scalars(float(measurement.snr_db[0])))

    def _grid(
        self, entity: str, frame: GridFrame, rgba: UInt8[np.ndarray, "ny nx 4"], draw_order: float
    ) -> None:
        rr, (rows, columns) = self._rr, frame.shape
        form = rr.components.ImageFormat(
            width=columns, height=rows, color_model="RGBA", channel_datatype="U8"
        )
        # Rerun draws the first row farthest from the corner, as in a picture.
        data = np.ascontiguousarray(rgba[::-1]).tobytes()
        corner = [*frame.origin_xy, 0.001 * draw_order]
        grid = rr.GridMap(
            data=data, format=form, cell_size=frame.resolution_m, translation=corner, draw_order=draw_order
        )
        self._log(entity, grid)


def rerun_sdk() -> ModuleType:
    """The Rerun SDK; ValueError if it is not installed."""
    try:
        import rerun
    except ImportError as error:
        raise ValueError(
            f"Rerun is not installed ({error}). Install it with `{install_command('viz')}`, or draw the episode "
            "without it: `robosim replay DIR`."
        ) from error
    return rerun


def rays(paths: Paths) -> list[Float[np.ndarray, "_ 3"]]:
    """Corners of each path, from the transmitter to the receiver [m]."""
    return [
        np.vstack([paths.tx_position[tx], points[: int(order)], paths.rx_position[rx]])
        for tx, rx, order, points in zip(paths.tx, paths.rx, paths.order, paths.point, strict=True)
    ]


def ray_kind(interaction: UInt8[np.ndarray, " m"]) -> str:
    """Kind of interactions of a path, as a key of `RAY_COLOURS`."""
    met = {Interaction(int(kind)) for kind in interaction} - {Interaction.NONE}
    if Interaction.TRANSMISSION in met:
        return "transmission"
    if Interaction.SCATTERING in met:
        return "scattering"
    names = [kind.name.lower() for kind in (Interaction.REFLECTION, Interaction.DIFFRACTION) if kind in met]
    return " and ".join(names) or "line of sight"


def _words(state: LinkState) -> str:
    return state.name.lower().replace("_", " ")


def _raised(points: Float[np.ndarray, "n 2"], height_m: float) -> Float[np.ndarray, "n 3"]:
    return np.column_stack([points, np.full(len(points), height_m)])


def _mass_at_peak(belief: Belief, radius_m: float = 0.5) -> float:
    """Largest probability within a square of half a side around a cell."""
    n = 2 * round(radius_m / belief.frame.resolution_m) + 1
    mass = cv2.boxFilter(belief.probability(), -1, (n, n), normalize=False, borderType=cv2.BORDER_CONSTANT)
    return float(mass.max())


def _tinted(belief: Layer) -> UInt8[np.ndarray, "ny nx 4"]:
    """The likelier, the more opaque."""
    rgba = np.empty((*belief.values.shape, 4), np.uint8)
    rgba[..., :3] = TARGET_RED
    rgba[..., 3] = 0.7 * 255 / TOP_LEVEL * belief.values
    return rgba


def _layout() -> Any:
    """The world next to the camera, above the time lines."""
    import rerun.blueprint as rrb

    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(
                rrb.Spatial3DView(origin="world", name="world"),
                rrb.Vertical(
                    rrb.Spatial2DView(origin="world/camera", contents="/world/camera/rgb", name="camera"),
                    rrb.Spatial2DView(origin="world/camera", contents="/world/camera/depth", name="depth"),
                ),
                column_shares=[3, 1],
            ),
            rrb.Horizontal(
                rrb.TimeSeriesView(origin="link", contents="/link/snr_db", name="SNR"),
                rrb.StateTimelineView(origin="link", name="link state"),
                rrb.TimeSeriesView(origin="link/probability", name="link state probability"),
                rrb.TimeSeriesView(origin="pose", name="pose error"),
                rrb.TimeSeriesView(origin="belief", name="belief"),
            ),
            row_shares=[3, 1],
        )
    )
