"""The camera of one ray a column: depth of the ray-casting engine, in plans, among furniture and of the target."""

import numpy as np
import pytest

from robosim.building.building import make_building
from robosim.building.reach import reach
from robosim.camera.cameras import make_camera
from robosim.camera.model import CameraConfig, camera_pose
from robosim.camera.target import target_mesh
from robosim.generator.generate import GeneratorConfig, generate_plan
from robosim.plans.files import read_plan

SMALL = CameraConfig(width=64, height=48)


@pytest.mark.parametrize(
    "plan",
    [read_plan("flat"), generate_plan(3, config=GeneratorConfig(heights=True))],
    ids=["walls", "furniture of true height"],
)
def test_depth_is_that_of_casting_a_ray_for_each_pixel(plan):
    """Embree is the judge: within 1 mm + 0.1 % in all pixels but 0.2 %, along silhouettes of furniture."""
    building = make_building(plan)
    centres = plan.centres(reach(building, 0.18).parts == 1)
    rng = np.random.default_rng(0)
    target = centres[rng.integers(len(centres))]
    meshes = [building.mesh, target_mesh(target, ceiling_m=building.height_m)]
    ours, judge = (make_camera(meshes, SMALL, backend=backend) for backend in ("plan", "embree"))
    off = []
    for _ in range(40):
        pose = np.array([*centres[rng.integers(len(centres))], rng.uniform(-np.pi, np.pi)])
        T = camera_pose(pose, SMALL)
        depth, true = ours.render(T).depth, judge.render(T).depth
        off.append(np.abs(depth - true) > 1e-3 + 1e-3 * true)
    assert np.mean(off) < 2e-3


def test_target_is_seen_before_the_wall_in_its_colours():
    """From 1 m the box of the markers fills the columns ahead, 0.84 m away, in black and white."""
    building = make_building(read_plan("flat"))
    centre = reach(building, 0.18).widest()
    meshes = [building.mesh, target_mesh(centre, ceiling_m=building.height_m)]
    camera = make_camera(meshes, CameraConfig(width=64, height=64, height_m=1.72), backend="plan")
    config = CameraConfig(width=64, height=64, height_m=1.72)
    frame = camera.render(camera_pose(np.array([centre[0] - 1.0, centre[1], 0.0]), config))
    assert frame.depth[30:34, 30:34] == pytest.approx(0.84, abs=1e-5)
    box = frame.rgb[26:38, 26:38]
    assert {tuple(colour) for colour in box.reshape(-1, 3).tolist()} == {(0, 0, 0), (255, 255, 255)}


def test_it_looks_level_only_and_not_once_closed():
    building = make_building(read_plan("flat"))
    camera = make_camera([building.mesh], SMALL, backend="plan")
    T = camera_pose(np.array([1.0, 1.0, 0.0]), SMALL)
    tilted = T.copy()
    c, s = np.cos(0.2), np.sin(0.2)
    tilted[:3, :3] = T[:3, :3] @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    with pytest.raises(ValueError, match="expected straight down"):
        camera.render(tilted)
    with pytest.raises(ValueError, match="4 by 4"):
        camera.render(np.full((4, 4), np.nan))
    camera.close()
    with pytest.raises(RuntimeError, match="closed"):
        camera.render(T)
