"""Recordings as one HTML file that plays without Python and without a network.

viser's client is one file, and reads the messages that draw a scene from a variable in it. Panels are not recorded: a
legend covers a corner instead.
"""

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robosim.live.building_scene import FIELD_DEG, light, view_of_all
from robosim.live.page_html import search_legend
from robosim.live.recordings import Recording
from robosim.live.scene_nodes import NO_SHADOW
from robosim.live.search_view import SearchView
from robosim.live.server import HOST, SOFTWARE, before_client, close_server, open_server
from robosim.support.files import write_whole

if TYPE_CHECKING:
    import viser

#: Largest number of steps in a file, evenly distributed, which bounds its size.
MOST_STEPS = 120
#: Steps per second.
SPEED_PER_S = 6.0
#: Width of the camera's picture over that of the plan.
_PICTURE = 0.3
#: Shape of the window that the view fits.
_ASPECT = 1.3
#: A narrower window, such as a phone's, shows as much from left to right; viser reads the field of view [rad] from the
#: address.
_NARROW = f"""<script>(() => {{
  const narrow = {_ASPECT} * innerHeight / innerWidth, get = URLSearchParams.prototype.get;
  if (narrow <= 1) return;
  const field = 2 * Math.atan(narrow * Math.tan({np.radians(FIELD_DEG) / 2}));
  URLSearchParams.prototype.get = function (name) {{
    const value = get.call(this, name);
    return value === null && name === 'initialCameraFov' ? String(field) : value;
  }};
}})();</script>"""
_STYLE = (
    "position:fixed;left:8px;top:8px;max-width:min(26em,calc(100vw - 16px));background:rgba(255,255,255,.88);"
    "border-radius:6px;padding:6px 4px;z-index:5;font:13px/1.35 system-ui,sans-serif;color:#222"
)


def export(recordings: Sequence[Recording], path: Path) -> None:
    """Write one or two recordings as a page (.html); ValueError if viser is not installed."""
    write_whole(Path(path), export_page(recordings).encode())


def export_page(recordings: Sequence[Recording]) -> str:
    """Return a page with one or two recordings side by side; ValueError if viser is not installed."""
    # A server of its own, so that the scene of another page stays unchanged.
    server = open_server(HOST, 0, "export")
    try:
        page = _record(server, recordings)
    finally:
        close_server(server)
    title = escape(
        " | ".join(f"{recording.title}: {recording.outcome or 'running'}" for recording in recordings)
    )
    legend = search_legend([robot.robot for robot in recordings[0].robots])
    legend = f'<details open style="{_STYLE}"><summary><b>{title}</b></summary>{legend}</details>'
    page = page.replace("<title>Viser</title>", f"<title>{title}</title>", 1)
    end = page.rindex("</body>")
    return page[:end] + legend + page[end:]


def _record(server: "viser.ViserServer", recordings: Sequence[Recording]) -> str:
    light(server.scene)
    views, pictures, offset_m, width_m = [], [], 0.0, 0.0
    for k, recording in enumerate(recordings):
        view = SearchView(server, f"/{k}", recording, offset_m, brief=len(recordings) > 1)
        width_m = _PICTURE * float(view.building.size.max())
        pictures.append(_add_picture(server, f"/{k}", view, width_m))
        views.append(view)
        offset_m += float(view.building.size[0]) + 1.4 * width_m + 1.0
    eye, target = view_of_all([view.building for view in views], _ASPECT, right_m=1.2 * width_m)
    camera = server.initial_camera
    camera.position, camera.look_at = tuple(eye), tuple(target)
    camera.up, camera.fov = (0.0, 0.0, 1.0), float(np.radians(FIELD_DEG))
    count = max(len(robot) for recording in recordings for robot in recording.robots)
    numbers = np.unique(np.linspace(0, count - 1, min(MOST_STEPS, count)).round().astype(int))
    serializer = server.get_scene_serializer()
    for number in numbers.tolist():
        for view, picture in zip(views, pictures, strict=True):
            steps = view.show(number)
            if steps and picture is not None:
                picture.image = steps[0].sensed.rgb
        serializer.insert_sleep(1 / SPEED_PER_S)
    return before_client(serializer.as_html(), SOFTWARE, _NARROW)


def _add_picture(server: "viser.ViserServer", root: str, view: SearchView, width_m: float) -> Any:
    """The camera's picture to the right of the plan; None if it is not recorded."""
    first = view.recording[0].sensed.rgb
    if not first.size:
        return None
    depth_m = width_m * first.shape[0] / first.shape[1]
    high = view.building.high
    x, y = float(high[0] + 0.65 * width_m), float(high[1] - depth_m / 2)
    label_at = (x, y - depth_m / 2, 0.0)
    server.scene.add_label(f"{root}/camera_name", "camera", position=label_at, anchor="top-center")
    return server.scene.add_image(
        f"{root}/camera", first, width_m, depth_m, format="jpeg", jpeg_quality=70, position=(x, y, 0.02),
        wxyz=(0.0, 1.0, 0.0, 0.0), **NO_SHADOW,
    )  # fmt: skip
