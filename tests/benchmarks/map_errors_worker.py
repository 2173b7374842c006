"""Radio maps of Sionna RT in a scene, run by a Python that has it: `python map_errors_worker.py SCENE MAP RESULT`.

MAP is an npz file with tx (3,), center (3,) and size (2,) of the map, cell_m, frequency_hz, depth and samples (a list).
RESULT gets version, and for each number of samples s gain_s (rows upwards, columns) and cpu_s_s, the CPU time of a warm
run.
`DRJIT_LIBLLVM_PATH` names LLVM 19 to Dr.Jit where it would take version 15, which cannot compile the solver.
"""

import sys
import time

import numpy as np


def main(scene_file: str, map_file: str, result_file: str) -> None:
    """Make the map with each number of samples, after a map that compiles."""
    import mitsuba

    mitsuba.set_variant("llvm_ad_mono_polarized")
    from sionna import rt

    wanted = np.load(map_file)
    scene = rt.load_scene(scene_file)
    scene.frequency = float(wanted["frequency_hz"])
    scene.tx_array = scene.rx_array = rt.PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="V")
    scene.add(rt.Transmitter("tx", position=wanted["tx"].tolist()))
    solver, maps = rt.RadioMapSolver(), {"version": rt.__version__}

    def draw(samples: int) -> np.ndarray:
        return np.array(
            solver(
                scene, center=wanted["center"].tolist(), orientation=[0.0, 0.0, 0.0], size=wanted["size"].tolist(),
                cell_size=[float(wanted["cell_m"])] * 2, samples_per_tx=samples, max_depth=int(wanted["depth"]),
                refraction=False,
            ).path_gain
        )[0]  # fmt: skip

    draw(1000)
    for samples in wanted["samples"].tolist():
        begin = time.process_time()
        maps[f"gain_{samples}"] = draw(samples)
        maps[f"cpu_s_{samples}"] = time.process_time() - begin
    np.savez(result_file, **maps)


if __name__ == "__main__":
    main(*sys.argv[1:])
