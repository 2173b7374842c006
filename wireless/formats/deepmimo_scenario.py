"""Traced paths as a DeepMIMO v4 scenario, a folder that `deepmimo.load` opens.

One file per transmitter and quantity, `QUANTITY_t000_txNNN_r001.npz`: power [dBW received for 1 W sent], phase
[degrees], delay [s], aoa_az, aoa_el, aod_az, aod_el [degrees, elevation from the zenith], inter (kinds of
interactions as decimal digits from the transmitter on: 1 reflection, 2 diffraction, 4 transmission, 0 line of
sight) and inter_pos [m], each receiver by path, NaN for missing paths; rx_pos and tx_pos [m]. The folder also has
`params.json`, and the building as triangles.

`deepmimo.load("NAME")` looks for the folder in `deepmimo_scenarios` below the working directory, by its name
in lower case. Left out: antennas (gains are between isotropic ones), more than one polarisation.
Reference: DeepMIMO 4.0, deepmimo.net.
"""

import io
import json
import re
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Int

from wireless.em.materials import Material, properties, scattering_of
from wireless.paths import Paths
from wireless.tracing.tracer import TracerConfig

#: Version of the format.
VERSION = "4.0.0"
N_PATHS = 25
_TX_SET, _RX_SET = 0, 1


def scenario_name(name: str) -> str:
    """A valid name of a scenario: in lower case, without blanks, slashes and the like."""
    return re.sub(r"[^a-z0-9._-]+", "_", name.lower()).strip("._") or "scenario"


def transmitter_files(paths: Paths, tx: int, *, horizontal: bool = False) -> dict[str, bytes]:
    """The paths of one transmitter as files by name; phases of horizontal polarisation, else of vertical."""
    strongest = paths.select(paths.tx == tx).strongest(N_PATHS)
    n_rx, width = len(strongest.rx_position), max(1, int(strongest.rank.max(initial=0)) + 1)
    place = strongest.rx, strongest.rank

    def by_receiver(values: np.ndarray, kind: type = np.float32) -> np.ndarray:
        out = np.full((n_rx, width, *values.shape[1:]), np.nan, kind)
        out[place] = values
        return out

    p = int(horizontal)
    matrices = {
        "power": by_receiver(strongest.power_db),
        "phase": by_receiver(np.degrees(np.angle(strongest.gain[:, p, p]))),
        "delay": by_receiver(strongest.delay_s),
        "aoa_az": by_receiver(np.degrees(strongest.aoa_az)),
        "aoa_el": by_receiver(90 - np.degrees(strongest.aoa_el)),
        "aod_az": by_receiver(np.degrees(strongest.aod_az)),
        "aod_el": by_receiver(90 - np.degrees(strongest.aod_el)),
        "inter": by_receiver(strongest.digits, np.float64),  # up to ten digits, too many for float32
        "inter_pos": by_receiver(strongest.point),
        "rx_pos": strongest.rx_position.astype(np.float32),
        "tx_pos": strongest.tx_position[tx : tx + 1].astype(np.float32),
    }
    return {
        f"{name}_t{_TX_SET:03}_tx{tx:03}_r{_RX_SET:03}.npz": _npz({name: matrix})
        for name, matrix in matrices.items()
    }


def scene_files(
    *,
    mesh: trimesh.Trimesh,
    materials: tuple[str | Material, ...],
    face_material: Int[np.ndarray, " n_faces"],
    frequency_hz: float,
    config: TracerConfig,
    n_tx: int,
    n_rx: int,
    n_rx_active: int,
) -> dict[str, bytes]:
    """The building and the parameters of a scenario, as files by their names in its folder."""
    faces, vertices = np.asarray(mesh.faces), np.asarray(mesh.vertices, np.float32)
    used = np.unique(face_material)
    objects = [
        {"name": str(materials[m]), "label": "buildings", "id": int(m), "mesh_key": str(m)} for m in used
    ]
    params = {
        "version": VERSION,
        "rt_params": _rt_params(frequency_hz, config),
        "scene": {
            "num_scenes": 1,
            "n_objects": len(objects),
            "n_vertices": len(vertices),
            "n_faces": len(faces),
            "n_triangular_faces": len(faces),
            "representation": "mesh",
        },
        "materials": {
            f"material_{i}": _material(i, name, frequency_hz, config) for i, name in enumerate(materials)
        },
        "txrx_sets": {
            f"txrx_set_{_TX_SET}": _set("tx", _TX_SET, n_tx, n_tx),
            f"txrx_set_{_RX_SET}": _set("rx", _RX_SET, n_rx, n_rx_active),
        },
    }
    return {
        "vertices.npz": _npz({"vertices": vertices}),
        "faces.npz": _npz({str(m): faces[face_material == m] for m in used}),
        "materials.npz": _npz({str(m): np.full((face_material == m).sum(), m) for m in used}),
        "objects.json": json.dumps(objects, indent=2).encode(),
        "params.json": json.dumps(params, indent=2, allow_nan=False).encode(),
    }


def _npz(arrays: dict[str, np.ndarray]) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def _rt_params(frequency_hz: float, config: TracerConfig) -> dict[str, Any]:
    diffracted = config.diffraction_reflections + 1 if config.diffraction else 0
    return {
        "raytracer_name": "wireless.tracing.tracer (robosim)",
        "raytracer_version": "exact images and UTD",
        "frequency": frequency_hz,
        "max_path_depth": max(config.max_reflections, diffracted) + config.walls_passed(frequency_hz),
        "max_reflections": config.max_reflections,
        "max_diffractions": int(config.diffraction),
        "max_scattering": int(config.scattering is not None),
        "max_transmissions": config.walls_passed(frequency_hz),
        "diffuse_reflections": 0,
        "diffuse_diffractions": 0,
        "diffuse_transmissions": 0,
        "diffuse_final_interaction_only": False,
        "diffuse_random_phases": False,
        "terrain_reflection": bool(config.floor_ceiling),
        "terrain_diffraction": False,
        "terrain_scattering": False,
        "num_rays": 0,
        "ray_casting_method": "none",
        "synthetic_array": True,
        "ray_casting_range_az": 360.0,
        "ray_casting_range_el": 180.0,
        "gps_bbox": [0, 0, 0, 0],
        "raw_params": {},
    }


def _material(number: int, name: str | Material, frequency_hz: float, config: TracerConfig) -> dict[str, Any]:
    relative, conductivity = properties(name, frequency_hz)
    share, lobe = scattering_of(name, config.scattering or 0.0, config.scattering_lobe)
    if config.scattering is None:  # the tracer scatters nothing, whatever materials state
        share = 0.0
    return {
        "id": number,
        "name": str(name),
        "permittivity": relative,
        "conductivity": conductivity,
        "scattering_model": "none" if not share else "lambertian" if lobe is None else "directive",
        "scattering_coefficient": share,
        "alpha_r": 4 if lobe is None else lobe,
        "lambda_param": 1.0,  # the lobe about the mirrored direction alone
        "cross_polarization_coefficient": 0.0,
    }


def _set(name: str, number: int, n_points: int, n_active: int) -> dict[str, Any]:
    return {
        "name": name,
        "id_orig": number,
        "id": number,
        "is_tx": name == "tx",
        "is_rx": name == "rx",
        "num_points": n_points,
        "num_active_points": n_active,
        "num_ant": 1,
        "dual_pol": False,
        "ant_rel_positions": [[0, 0, 0]],
        "array_orientation": [0, 0, 0],
    }
