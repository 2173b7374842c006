"""A small good file for each reader of the command line, and the command that reads it: seeds of damage."""

from pathlib import Path

import trimesh

from robosim.plans.files import write_ros
from tests.made_robots import MJCF, TWO, URDF
from tests.plans import two_rooms

#: What begins the work, which is not done here.
STOPS = (
    "wireless.tracing.tracer.Tracer.trace",
    "robosim.drawing.plots.plot_plan",
    "robosim.simulator.Simulator._observe",
    "robosim.evaluation.evaluate.run_jobs",
    "robosim.positioning.beacon_figure.draw_beacons",
    "robosim.commands.locate_logs.locate_log",
    "robosim.positioning.power_route.map_log",
)
_ANGLES = "\n".join(f"{angle} {min(abs((angle + 180) % 360 - 180) / 6, 25)}" for angle in range(0, 360, 10))
_GRID = "\n".join(f"{a},{e},{-abs(a - 180) / 60}" for a in range(0, 360, 30) for e in range(-90, 91, 30))
_READINGS = [(f"{0.5 + 0.1 * k:.2f}", f"{0.5 + 0.05 * k:.2f}", -40 - k) for k in range(24)]
_PLACES = [(0.5 + 0.1 * (k % 8), 0.5 + 0.3 * (k // 8), -40 - k) for k in range(64)]
_POSES = "\n".join(f"{k} {0.1 * k:.1f} 0 0 0 0 0 1" for k in range(10))
FILES = {
    "map.yaml": "image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
    "occupied_thresh: 0.65\nfree_thresh: 0.2",
    "cart.urdf": URDF.replace("WHEELS", TWO).replace("</robot>", '<gazebo reference="base_scan"><sensor type="ray">'
    "<topic>scan</topic><vertical><samples>1</samples><min_angle>0</min_angle><max_angle>0</max_angle></vertical>"
    "<range><min>0.1</min><max>inf</max></range></sensor></gazebo></robot>"),
    "disk.xml": MJCF,
    "robot.yaml": "radius_m: 0.25\nmass_kg: 4\n",
    "sector.msi": f"NAME a\nGAIN 8.15 dBi\nHORIZONTAL 36\n{_ANGLES}\nVERTICAL 36\n{_ANGLES}\n",
    "grid.csv": f"azimuth_deg,elevation_deg,gain_dbi\n{_GRID}\n",
    "route.csv": "beacon,time_s,x_m,y_m,power_dbm\n" + "".join(
        f"a,{k},{x},{y},{power}\n" for k, (x, y, power) in enumerate(_READINGS)),
    "powers.csv": "beacon,beacon_x_m,beacon_y_m,beacon_z_m,x_m,y_m,power_dbm\n" + "".join(
        f"a,0.5,0.5,2.0,{x:.1f},{y:.1f},{power}\n" for x, y, power in _PLACES),
    "movers.yaml": "- door: [3.1, 1.1]\n  width_m: 0.8\n  open_s: [[5, 15]]\n- crowd: crowd.csv\n"
    "- trajectory: cart.tum\n",
    "crowd.csv": "time,id,x,y\n0,a,1,1\n9,a,1,1.5\n",
    "cart.tum": "0 1 1 0 0 0 0 1\n9 1 1.5 0 0 0 0 1\n",
    "wall.yaml": "layers:\n- {relative_permittivity: 2.2, conductivity_spm: 0.01, thickness_m: 0.06}\n",
    "room.yaml": "- {piece: table, at: [0.7, 0.7], z_m: 0}\n- {mesh: box.stl, at: [2.2, 1.5], unit_m: 0.5}\n",
    "house.yaml": "storeys:\n- {plan: map.yaml, height: 2.6, slab: 0.25}\n- {plan: map.yaml, offset: [0, 0]}\n",
    "suite.yaml": "seed: 0\nplans: {m: map.yaml}\ntasks:\n- {plan: m, start: [0.5, 0.5, 90], target: [2.5, 1.5]}\n"
    "- {plan: m, start: [0.6, 0.5, 90], target: [2.5, 1.5]}\n",
    "plan.svg": '<svg xmlns="http://www.w3.org/2000/svg" width="600cm" height="400cm" viewBox="0 0 600 400">'
    '<path d="M0 0H600V400H0ZM20 20v360h560V20z"/><circle cx="200" cy="200" r="30"/></svg>',
    "floor.ply": "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n50 0 0\n50 50 0\n0 50 0\n4 0 1 2 3\n",
    "scene.xml": '<scene version="2.1.0"><bsdf type="radio-material" id="m"><float name="relative_permittivity" '
    'value="5"/><float name="conductivity" value="0.1"/><float name="thickness" value="0.2"/></bsdf><shape type="ply" '
    'id="p"><string name="filename" value="floor.ply"/><ref id="m" name="bsdf"/></shape><include filename="part.xml"/>'
    '<shape type="rectangle" id="q"><transform name="to_world"><scale value="50"/></transform><ref id="m" name="bsdf"/>'
    "</shape></scene>",
    "part.xml": '<scene version="2.1.0"><shape type="obj" id="w"><string name="filename" value="wall.obj"/><ref '
    'id="m"/></shape></scene>',
    "wall.obj": "v 0 0 0\nv 4 0 0\nv 4 0 2\nv 0 0 2\nf 1 2 3\nf 1 3 4\n",
    "scans.txt": "\n".join(f"{k} -1.5 1.5 {'2.5 ' * 20}" for k in range(10)),
    "log.tum": _POSES,
    "drive.clf": "\n".join(f"FLASER 180 {'2.5 ' * 180}{0.1 * k} 0 0 {0.1 * k} 0 0 {k} host {k}" for k in range(10)),
}  # fmt: skip
FILES |= {"paint.yaml": FILES["wall.yaml"], "along.tum": FILES["cart.tum"], "log.csv": FILES["route.csv"]}
_EPISODE = "episode {0}/map.yaml --mover {0}/movers.yaml --physics kinematic --camera none --mapper classical --lidar "
_EPISODE += "rplidar-a1 --no-video --max-steps 1 --goal explore"
_CSI = "trace {0}/map.yaml --tx 1,1 --rx 2,1 --csi 8x1MHz --tx-antenna {0}/"
_SCENE, _SLAM = "trace {0}/scene.xml --inspect", "slam --inspect {0}/log.tum --scans {0}/scans.txt"
#: Command that reads each file.
COMMANDS = {
    "map.yaml": "plan {0}/map.yaml", "cart.urdf": "robot {0}/cart.urdf", "disk.xml": "robot {0}/disk.xml",
    "robot.yaml": "robot {0}/robot.yaml", "sector.msi": _CSI + "sector.msi", "grid.csv": _CSI + "grid.csv",
    "route.csv": "locate {0}/route.csv --plan {0}/map.yaml", "movers.yaml": _EPISODE, "crowd.csv": _EPISODE,
    "powers.csv": "calibrate-materials {0}/map.yaml {0}/powers.csv", "cart.tum": _EPISODE,
    "wall.yaml": "trace {0}/map.yaml --tx 1,1 --rx 2,1 --material {0}/wall.yaml",
    "room.yaml": "plan {0}/map.yaml --furnishings {0}/room.yaml",
    "house.yaml": "trace {0}/house.yaml --tx 1,1 --rx 2,1",
    "suite.yaml": "evaluate {0}/suite.yaml --policies snr --workers 1", "plan.svg": "plan {0}/plan.svg",
    "floor.ply": _SCENE, "scene.xml": _SCENE, "part.xml": _SCENE, "wall.obj": _SCENE,
    "scans.txt": _SLAM, "log.tum": _SLAM,
    "drive.clf": "slam --inspect {0}/drive.clf",
    "map.pgm": "slam {0}/drive.clf --map {0}/map.yaml",
    "paint.yaml": "trace {0}/scene.xml --inspect --scene-material m={0}/paint.yaml",
    "along.tum": "trace {0}/map.yaml --tx 4,1 --along {0}/along.tum",
    "log.csv": "locate {0}/log.csv --map-from {0}/drive.clf --not-received 100",
}  # fmt: skip

for _name, _words in COMMANDS.items():
    if "--inspect" not in _words and not _words.startswith("robot"):
        COMMANDS[_name] = f"{_words} --out {{0}}/out"


def write_files(folder: Path) -> None:
    """Write all files."""
    folder.mkdir(parents=True, exist_ok=True)
    write_ros(two_rooms(0.8), folder / "map.yaml")
    trimesh.creation.box((1, 1, 1)).export(folder / "box.stl")
    for name, text in FILES.items():
        (folder / name).write_text(text)
