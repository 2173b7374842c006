"""Paths of Sionna RT in a scene, run by a Python that has it: `python tracer_peer_worker.py SCENE PLACES RESULT`.

PLACES is an npz file with tx (3,), rx (n, 3), frequency_hz, depth and samples (a list). For each number of samples s,
RESULT gets delay_s_s, power_s and turns_s (n, paths; power is NaN where there is no path), the last of which counts
interactions, and cpu_s_s, the CPU time of a warm run.
"""

import sys
import time

import numpy as np


def main(scene_file: str, places_file: str, result_file: str) -> None:
    """Trace the links, once to compile and once to measure, with each number of samples."""
    import mitsuba

    mitsuba.set_variant("llvm_ad_mono_polarized")
    from sionna import rt

    places = np.load(places_file)
    scene = rt.load_scene(scene_file, merge_shapes=False)
    scene.frequency = float(places["frequency_hz"])
    array = rt.PlanarArray(num_rows=1, num_cols=1, pattern="iso", polarization="V")
    scene.tx_array = scene.rx_array = array
    scene.add(rt.Transmitter("tx", position=places["tx"].tolist()))
    for number, place in enumerate(places["rx"]):
        scene.add(rt.Receiver(f"rx{number}", position=place.tolist()))
    solver, found = rt.PathSolver(), {"version": rt.__version__}
    for samples in places["samples"].tolist():
        for _ in range(2):
            begin = time.process_time()
            paths = solver(
                scene, max_depth=int(places["depth"]), samples_per_src=samples, max_num_paths_per_src=5_000_000,
                synthetic_array=True, refraction=False, diffraction=False,
            )  # fmt: skip
            delay = np.array(paths.tau)
            seconds = time.process_time() - begin
        gain = np.array(paths.a[0]) + 1j * np.array(paths.a[1])
        n_rx = len(places["rx"])
        delay, gain = delay.reshape(n_rx, -1), gain.reshape(n_rx, -1)
        power = np.where(delay >= 0, np.abs(gain) ** 2, np.nan)
        turns = (np.array(paths.interactions) != 0).sum(axis=0).reshape(n_rx, -1)
        found |= {f"delay_s_{samples}": delay, f"power_{samples}": power, f"turns_{samples}": turns}
        found[f"cpu_s_{samples}"] = seconds
    np.savez(result_file, **found)


if __name__ == "__main__":
    main(*sys.argv[1:])
