"""A recording as one HTML file that plays without Python and without a network.

viser's client is one file, and takes the messages that draw a scene from a variable in it. A legend is laid over it,
since panels are not recorded.
"""

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from robosim.live.building_scene import FIELD_DEG, light, view_from_above
from robosim.live.client import before_client
from robosim.live.lean import SCRIPT as LEAN
from robosim.live.page_html import search_legend
from robosim.live.recording import Recording
from robosim.live.search_view import SearchView
from robosim.live.server import HOST, close_server, open_server
from robosim.support.checks import check_number
from robosim.support.files import write_whole

if TYPE_CHECKING:
    import viser

#: Moments of a file: more would make it larger than a page should be.
MOST_MOMENTS = 120
#: How fast it plays [moments a second].
PER_S = 6.0
#: Width of the camera's picture beside the plan, over the plan's.
_PICTURE = 0.3
#: Shape of the window that the view is chosen for.
_ASPECT = 1.3
#: A narrower window, as a phone's, shows as much from left to right; viser asks the address for the field [rad].
_NARROW = f"""<script>(() => {{
  const narrow = {_ASPECT} * innerHeight / innerWidth, get = URLSearchParams.prototype.get;
  if (narrow <= 1) return;
  const field = 2 * Math.atan(narrow * Math.tan({np.radians(FIELD_DEG) / 2}));
  URLSearchParams.prototype.get = function (name) {{
    const asked = get.call(this, name);
    return asked === null && name === 'initialCameraFov' ? String(field) : asked;
  }};
}})();</script>"""
_STYLE = (
    "position:fixed;left:8px;top:8px;max-width:min(26em,calc(100vw - 16px));background:rgba(255,255,255,.88);"
    "border-radius:6px;padding:6px 4px;z-index:5;font:13px/1.35 system-ui,sans-serif;color:#222"
)


def exported(
    recordings: Sequence[Recording], *, most_moments: int = MOST_MOMENTS, per_s: float = PER_S
) -> str:
    """Recordings side by side as a page.

    Args:
        recordings: One or two.
        most_moments: Evenly over the recording, the first and the last among them.
        per_s: How many of them are shown a second.

    Returns:
        The page's text.

    Raises:
        ValueError: If viser is not installed, or a number makes no sense.
    """
    check_number("most_moments", most_moments, 2, 5000, "moments", whole=True)
    check_number("per_s", per_s, 0.1, 60, "moments a second")
    # A server of its own, which nobody is told of: what others look at stays as it is.
    server = open_server(HOST, 0, "export")
    try:
        return _with_legend(_recorded(server, recordings, most_moments, per_s), recordings)
    finally:
        close_server(server)


def export(recordings: Sequence[Recording], path: Path) -> None:
    """Write recordings as a page.

    Args:
        recordings: One or two.
        path: The file, .html.

    Raises:
        ValueError: If viser is not installed.
    """
    write_whole(Path(path), exported(recordings).encode())


def _recorded(server: "viser.ViserServer", recordings: Sequence[Recording], most: int, per_s: float) -> str:
    light(server.scene)
    views, pictures, offset = [], [], 0.0
    for k, recording in enumerate(recordings):
        view = SearchView(server, f"/{k}", recording, (offset, 0.0), len(recordings) > 1)
        wide = _PICTURE * float(view.scenery.size.max())
        pictures.append(_frame(server, f"/{k}", view, wide))
        views.append(view)
        offset += float(view.scenery.size[0]) + 1.4 * wide + 1.0
    _look(server, views, 1.2 * _PICTURE * float(views[-1].scenery.size.max()))
    count = max(len(recording) for recording in recordings)
    chosen = np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(int))
    serializer = server.get_scene_serializer()
    for i in chosen.tolist():
        for view, picture in zip(views, pictures, strict=True):
            step = view.show(i)
            if step is not None and picture is not None:
                picture.image = step.sensed.rgb
        serializer.insert_sleep(1 / per_s)
    return before_client(serializer.as_html(), LEAN, _NARROW)


def _frame(server: "viser.ViserServer", root: str, view: SearchView, wide: float) -> Any:
    """The camera's picture, which lies beside the plan; none if none was recorded."""
    first = view.recording[0].sensed.rgb
    if not first.size:
        return None
    deep = wide * first.shape[0] / first.shape[1]
    x, y = view.scenery.high[0] + 0.65 * wide, view.scenery.high[1] - deep / 2
    picture = server.scene.add_image(
        f"{root}/camera", first, wide, deep, format="jpeg", jpeg_quality=70, cast_shadow=False,
        receive_shadow=False, position=(float(x), float(y), 0.02), wxyz=(0.0, 1.0, 0.0, 0.0),
    )  # fmt: skip
    label = (float(x), float(y - deep / 2), 0.0)
    server.scene.add_label(f"{root}/camera_name", "camera", position=label, anchor="top-center")
    return picture


def _look(server: "viser.ViserServer", views: Sequence[SearchView], beside: float) -> None:
    low = np.min([view.scenery.low + view.scenery.offset for view in views], axis=0)
    high = np.max([view.scenery.high + view.scenery.offset for view in views], axis=0)
    height_m = max(view.scenery.height_m for view in views)
    eye, target = view_from_above(low, high + np.array([beside, 0.0]), _ASPECT, height_m)
    camera = server.initial_camera
    camera.position, camera.look_at = tuple(eye), tuple(target)
    camera.up, camera.fov = (0.0, 0.0, 1.0), float(np.radians(FIELD_DEG))


def _with_legend(page: str, recordings: Sequence[Recording]) -> str:
    title = " | ".join(f"{one.title}: {one.ended or 'running'}" for one in recordings)
    overlay = (
        f'<details open style="{_STYLE}"><summary><b>{escape(title)}</b></summary>{search_legend()}</details>'
    )
    page = page.replace("<title>Viser</title>", f"<title>{escape(title)}</title>", 1)
    end = page.rindex("</body>")
    return page[:end] + overlay + page[end:]
