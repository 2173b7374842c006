"""Ultra-wideband ranges and levels measured in a furnished apartment against traced ones.

Walls are sheets of 5 cm of concrete; furniture stands as sheets around its corners, up to the ceiling. Its materials
are assumed, not fitted: boards of wood, books (and the folded bed) as 12 cm of relative permittivity 3 and 0.05 S/m,
mirrors as metal on both long sides. A range is the delay of the first detected peak
(`wireless.sounding.first_path`) and the device's offset; a level is the traced power and an offset, compressed towards
a largest one. Each link is predicted with offset and largest level of all other links. The simplest law, too: true
distance and an offset for ranges, a law of distance, compressed alike, for levels.
Data: Kolakowski, Zenodo 4742391 (CC BY 4.0).
"""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Bool, Float
from matplotlib.figure import Figure
from scipy.constants import speed_of_light
from scipy.optimize import least_squares
from tyro.conf import OmitArgPrefixes, Positional

from robosim.policies.likelihood import BEYOND_DISTANCE_M
from robosim.support.reading import reading
from tests.benchmarks.harness import DEFAULT, Options
from tests.benchmarks.measured_figures import draw_apartment, draw_responses
from tests.benchmarks.results import Results
from wireless.channel import Channel
from wireless.em.materials import Layer, Material
from wireless.paths import LinkState, Paths
from wireless.sounding.first_path import detect_first_path, range_merged_m
from wireless.tracing.tracer import Tracer, TracerConfig

#: Channel 2 of the device, and the least gain that exceeds noise [dB]: sent at -14 dBm, noise of the band at -87 dBm,
#: which the 1,024 symbols of the preamble lower by 30 dB.
FREQUENCY_HZ, BANDWIDTH_HZ, LEAST_GAIN_DB = 3.9936e9, 499.2e6, -100.0
#: Heights of modules, walls and furniture [m]; the publication has none.
_HEIGHT_M, _CEILING_M = 1.2, 2.5
#: Ranges that are longer by this have no detected direct path [m].
_NO_DIRECT_M = 0.3
_WALL = Material("wall", (Layer(thickness_m=0.05, material="concrete"),))
_BOARD = Material("board", (Layer(thickness_m=0.02, material="wood"),))
_BOOKS = Material("books", (Layer(thickness_m=0.12, relative_permittivity=3.0, conductivity_spm=0.05),))
_MIRROR = Material("mirror", (Layer(thickness_m=0.001, material="metal"),))
_MATERIALS = (_WALL, _BOARD, _BOOKS, _MIRROR)
_CONFIG = TracerConfig(max_reflections=4, max_transmissions=8, max_paths=1000, wall_passage="face")
#: Taps of noise before the first path, tap of the first path, and time of a tap [s].
_NOISE_TAPS, _FIRST_TAP, _TAP_S = 20, 30, 1.0016e-9


def main(folder: Positional[Path], *, options: OmitArgPrefixes[Options] = DEFAULT) -> Results:
    """Errors of traced ranges, levels, link states and delay spreads of ultra-wideband links in an apartment.

    Args:
        folder: The data set: links.csv, walls.csv, furniture.csv, cir.npz.
        options: Of every benchmark.
    """
    results = Results()
    with reading(folder / "links.csv", "measured links") as file:
        links = list(csv.DictReader(file.read().decode().splitlines()))

    def column(name: str) -> Float[np.ndarray, " n"]:
        return np.array([float(link[name]) for link in links])

    true_m, level_dbm, label = (
        column("true_m"),
        column("rsl_dbm"),
        np.array([link["label"] for link in links]),
    )
    excess_m = column("range_median_m") - true_m
    responses = [measured_response(folder, link["link"]) for link in links]
    _add_ranges(results, "true distance", excess_m, label, np.zeros(len(links)))
    for name, state in (("NLOS", LinkState.FIRST_ORDER), ("NDP NLOS", LinkState.HIGHER_ORDER)):
        own_m = excess_m[label == name] - np.median(excess_m[label == "LOS"])
        results.add("excess", name, "measured", float(own_m.mean()), "m", digits=2, cases=len(own_m))
        law_m = BEYOND_DISTANCE_M[state] + range_merged_m(BANDWIDTH_HZ)
        results.add("excess", name, "in the belief", law_m, "m", digits=2)
    _add_levels(results, "law of distance", level_dbm, -10 * np.log10(true_m), slope=True)
    for row, furnished in (("walls", False), ("walls and furniture", True)):
        traced = trace_links(folder, links, furnished)
        channels = [Channel.from_paths(paths) for paths in traced]
        delay_s = [detect_first_path(each, BANDWIDTH_HZ, LEAST_GAIN_DB)[0][0, 0] for each in channels]
        later_m = np.array(delay_s) * speed_of_light - true_m
        range_rest_m = _add_ranges(results, row, excess_m, label, later_m)
        for name in ("NLOS", "NDP NLOS"):
            results.add("excess", name, f"traced, {row}", float(later_m[label == name].mean()), "m", digits=2)
        gain_db = np.array([10 * np.log10(p.power.sum()) for p in traced])
        level_rest_db = _add_levels(results, row, level_dbm, gain_db)
        is_direct = np.array([(paths.order == 0).any() for paths in traced])
        state = np.where(is_direct, "LOS", np.where(later_m > _NO_DIRECT_M, "NDP NLOS", "NLOS"))
        results.add("states", row, "of three", 100 * float((state == label).mean()), "%", digits=0)
        right = (is_direct == (label == "LOS")).mean()
        results.add("states", row, "line of sight or not", 100 * float(right), "%", digits=0)
        ratio = np.array(
            [
                received_spread_s(channel, response) / measured_spread_s(response)
                for channel, response in zip(channels, responses, strict=True)
            ]
        )
        off = 100 * float(np.median(np.abs(ratio - 1)))
        results.add("delay spreads", row, "traced over measured, median", float(np.median(ratio)), digits=2)
        results.add("delay spreads", row, "median deviation", off, "%", digits=0, cases=len(links))
    sheets, material = read_sheets(folder, furnished=True)
    results.figures["apartment"] = draw_apartment(
        [(_MATERIALS[i].name, ends) for i, ends in zip(material, sheets, strict=True)],
        np.array([[_place(link, end)[0][:2] for end in ("anchor", "tag")] for link in links]),
        {
            "range, measured less traced [m]": (range_rest_m, 1.0),
            "level, measured less traced [dB]": (level_rest_db, 10.0),
        },
    )
    results.figures["impulse_responses"] = _draw_responses(links, responses, excess_m, true_m, channels)
    return options.finish("uwb_apartment", results)


def _draw_responses(
    links: list[dict[str, str]],
    responses: list[Float[np.ndarray, " taps"]],
    excess_m: Float[np.ndarray, " n"],
    true_m: Float[np.ndarray, " n"],
    channels: list[Channel],
) -> Figure:
    """Draw the link of each label whose range has the median excess."""
    label = np.array([link["label"] for link in links])
    offset_m = np.median(excess_m[label == "LOS"])
    shown = []
    for name in ("LOS", "NLOS", "NDP NLOS"):
        of = np.flatnonzero(label == name)
        i = int(of[np.argsort(excess_m[of])[len(of) // 2]])
        begin_s = (excess_m[i] - offset_m) / speed_of_light - _FIRST_TAP * _TAP_S
        title = f"{name}, link {links[i]['link']}, {true_m[i]:.1f} m"
        shown.append((title, responses[i], begin_s, channels[i], true_m[i] / speed_of_light))
    return draw_responses(shown, BANDWIDTH_HZ, _TAP_S)


def measured_response(folder: Path, link: str) -> Float[np.ndarray, " taps"]:
    """Mean power of the taps of a link."""
    with reading(folder / "cir.npz", "impulse responses") as file:
        taps = np.load(file)[f"cir_{link}"].astype(float)
    return np.asarray((taps**2).sum(axis=2).mean(axis=0))


def read_sheets(folder: Path, furnished: bool) -> tuple[Float[np.ndarray, "n 2 2"], list[int]]:
    """Ends of walls and of sides of furniture [m], and their places in `_MATERIALS`."""
    with reading(folder / "walls.csv", "walls") as file:
        walls = np.loadtxt(file, delimiter=",", skiprows=1).reshape(-1, 2, 2)
    sheets, material = list(walls), [0] * len(walls)
    with reading(folder / "furniture.csv", "furniture") as file:
        pieces = list(csv.DictReader(file.read().decode().splitlines())) if furnished else []
    for piece in pieces:
        corners = np.array([[float(piece[f"{axis}{i}_m"]) for axis in "xy"] for i in range(4)])
        sides = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
        is_long = np.argsort(np.argsort(np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1))) >= 2
        plain = 1 if "wardrobe" in piece["kind"] else 2
        sheets += list(sides)
        material += [3 if "mirror" in piece["kind"] and side else plain for side in is_long]
    return np.array(sheets), material


def trace_links(folder: Path, links: list[dict[str, str]], furnished: bool) -> list[Paths]:
    """Paths of each link, among walls alone or with furniture."""
    ends, material = read_sheets(folder, furnished)
    corner = np.zeros((len(ends), 4, 3))
    corner[:, [0, 3], :2], corner[:, [1, 2], :2], corner[:, 2:, 2] = ends[:, :1], ends[:, 1:], _CEILING_M
    faces = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(len(ends))[:, None, None]
    tracer = Tracer(
        trimesh.Trimesh(corner.reshape(-1, 3), faces.reshape(-1, 3), process=False),
        materials=_MATERIALS,
        face_material=np.repeat(material, 2),
        frequency_hz=FREQUENCY_HZ,
        config=_CONFIG,
    )
    return [tracer.trace(_place(link, "anchor"), _place(link, "tag"), workers=1) for link in links]


def _place(link: dict[str, str], end: str) -> list[list[float]]:
    return [[float(link[f"{end}_x_m"]), float(link[f"{end}_y_m"]), _HEIGHT_M]]


def measured_spread_s(response: Float[np.ndarray, " taps"]) -> float:
    """Root mean square delay spread of a measured response [s]."""
    return _spread(response, response[:_NOISE_TAPS].mean()) * _TAP_S


def received_spread_s(channel: Channel, response: Float[np.ndarray, " taps"]) -> float:
    """Root mean square delay spread of a traced channel in the bandwidth and noise of a measured response [s]."""
    power = np.abs(channel.taps(BANDWIDTH_HZ)[0, 0, 0, 0]) ** 2
    noise = power.max() * response[:_NOISE_TAPS].mean() / response.max()
    return _spread(power + noise, noise) / BANDWIDTH_HZ


def _spread(power: Float[np.ndarray, " taps"], noise: float) -> float:
    """Root mean square delay spread of the power of taps above three times the noise, in taps."""
    weight, tap = np.where(power > 3 * noise, power - noise, 0.0), np.arange(len(power))
    return float(np.sqrt(weight @ (tap - weight @ tap / weight.sum()) ** 2 / weight.sum()))


def _left_out(
    n: int, predict: Callable[[Bool[np.ndarray, " n"]], Float[np.ndarray, " n"]]
) -> Float[np.ndarray, " n"]:
    """Prediction of each link by what is fitted to the others."""
    return np.array([predict(np.arange(n) != k)[k] for k in range(n)])


def _add_ranges(
    results: Results,
    row: str,
    excess_m: Float[np.ndarray, " n"],
    label: np.ndarray,
    later_m: Float[np.ndarray, " n"],
) -> Float[np.ndarray, " n"]:
    rest = excess_m - _left_out(len(label), lambda used: later_m + np.median((excess_m - later_m)[used]))
    results.add(
        "ranges", row, "root mean square", float(np.sqrt((rest**2).mean())), "m", digits=2, cases=len(rest)
    )
    results.add("ranges", row, "median", float(np.median(np.abs(rest))), "m", digits=2)
    for name in dict.fromkeys(label):
        rms = float(np.sqrt((rest[label == name] ** 2).mean()))
        results.add("ranges", row, name, rms, "m", digits=2, cases=int((label == name).sum()))
    return rest


def _add_levels(
    results: Results,
    row: str,
    level_dbm: Float[np.ndarray, " n"],
    gain_db: Float[np.ndarray, " n"],
    slope: bool = False,
) -> Float[np.ndarray, " n"]:
    def predict(used: Bool[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        def level(x: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " n"]:
            power = x[0] + (x[2] if slope else 1.0) * gain_db
            return -10 * np.log10(10 ** (-power / 10) + 10 ** (-x[1] / 10))

        start = np.array([np.median(level_dbm - gain_db), level_dbm.max(), 2.0])
        return level(least_squares(lambda x: (level(x) - level_dbm)[used], start, loss="soft_l1").x)

    rest = level_dbm - _left_out(len(level_dbm), predict)
    results.add(
        "levels", row, "root mean square", float(np.sqrt((rest**2).mean())), "dB", digits=1, cases=len(rest)
    )
    low = level_dbm < -82
    rms = float(np.sqrt((rest[low] ** 2).mean()))
    results.add("levels", row, "below -82 dBm", rms, "dB", digits=1, cases=int(low.sum()))
    return rest
