"""Links of the published data whose strongest path is a lone diffraction, and how strong they are received.

The files have no powers of paths, but the SNRs that a simulated receiver estimated, which saturate above some 50 dB
(`wireless.estimation.public`). So each case's traced paths are received by that receiver too, with several draws of
phases, delays and noise, and SNR is compared with SNR: gains of the arrays, saturation and noise floor are on both
sides. The strength of the published transmitter follows from far links in line of sight: received as they are and
`STEP_DB` stronger, the offset is where their median SNR is the published one. It is needed since the published
constants leave some dB open, and since near links are saturated.
"""

from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from robosim.training.label_links import published_paths
from tests.benchmarks.edge_laws import Wedges
from tests.benchmarks.labels import in_the_clear, prepared
from wireless.estimation.public import PublicReceiver
from wireless.formats.mmwrobotnav_measurements import Measurements
from wireless.paths import Interaction, LinkState, Paths
from wireless.sounding.sounder import Rays
from wireless.tracing.scenes import PlanScene

#: A case's path is stronger than all that arrive within this angle of it, and than all others, by so much [dB].
NEAR_RAD, ALONE_DB, STRONGEST_DB = np.radians(20.0), 6.0, 3.0
#: Its published estimate lies within this [rad].
SAME_RAD = np.radians(4.0)
#: SNRs between which receivers neither saturate nor receive mostly noise, mean of published and received [dB].
CLEAN_DB = (22.0, 45.0)
#: Draws of the receiver, and what its offset is found by [dB].
DRAWS, STEP_DB = 6, 3.0
#: Links in line of sight that are far, and how many of a transmitter [m].
FAR_M, FAR_LINKS = 5.5, 40


@dataclass(frozen=True, kw_only=True, eq=False)
class Cases:
    """Lone single interactions of some transmitters, and far links in line of sight; a row for each."""

    kind: Float[np.ndarray, " m"]
    """`wireless.paths.Interaction`, 0 for line of sight."""
    published_db: Float[np.ndarray, " m"]
    """SNR of the strongest estimate, published."""
    received_db: Float[np.ndarray, " m"]
    """The same as received from traced paths, median of the draws."""
    again_db: Float[np.ndarray, " m"]
    """The same of one more draw: what a perfect law would be published as. For line of sight `STEP_DB` stronger."""
    n: Float[np.ndarray, " m"]
    phi_source: Float[np.ndarray, " m"]
    phi: Float[np.ndarray, " m"]
    before_m: Float[np.ndarray, " m"]
    after_m: Float[np.ndarray, " m"]

    def __len__(self) -> int:
        return len(self.kind)

    def select(self, some: Bool[np.ndarray, " m"]) -> "Cases":
        """Some of them."""
        return Cases(**{f.name: getattr(self, f.name)[some] for f in fields(self)})

    @property
    def wedges(self) -> Wedges:
        """Geometry, where `kind` is a diffraction."""
        names = (f.name for f in fields(Wedges))
        return Wedges(**{name: getattr(self, name) for name in names})

    @property
    def clean(self) -> Bool[np.ndarray, " m"]:
        """Which are neither saturated nor noise, by both SNRs alike, so that neither is preferred."""
        middle = (self.published_db + self.received_db) / 2
        return (middle > CLEAN_DB[0]) & (middle < CLEAN_DB[1])

    @staticmethod
    def joined(some: list["Cases"]) -> "Cases":
        """Those of several transmitters."""
        return Cases(**{f.name: np.concatenate([getattr(s, f.name) for s in some]) for f in fields(Cases)})


def find_cases(measured: Measurements, plan: Path, receiver: PublicReceiver, seed: int = 0) -> Cases:
    """Cases of one transmitter.

    Args:
        measured: Its published links.
        plan: File of the floor plan.
        receiver: The published one.
        seed: Of its noise, phases and delays.
    """
    building, tracer = prepared(plan)
    rx = np.column_stack([measured.rx_position, np.full(len(measured.rx_position), measured.tx_position[2])])
    paths = published_paths(measured.tx_position, rx, measured.rx_cell, tracer)
    clear = in_the_clear(building, measured.tx_position[:2], measured.rx_position)
    received_power = _received_power(paths, receiver)
    single, path = _alone(measured, paths, received_power, clear)
    far = _far(measured, paths, clear)
    received = _received(paths, np.concatenate([single, far]), receiver, seed, 0.0)
    stronger = _received(paths, far, receiver, seed, STEP_DB)
    again = _received(paths, single, receiver, seed + 1, 0.0, draws=1)
    m, k = len(single) + len(far), len(single)
    shape = {name: np.full(m, np.nan) for name in (f.name for f in fields(Wedges))}
    bent = np.flatnonzero(paths.interaction[path, 0] == Interaction.DIFFRACTION)
    corner = paths.primitive[path[bent], 0]
    assert isinstance(tracer.scene, PlanScene)  # as the published walls are
    of = tracer.scene.plan
    vertex = of.vertex[of.corner_vertex[corner]] + of.origin
    along = of.corner_along[corner]
    shape["n"][bent] = of.corner_gap_rad[corner] / np.pi
    for name, length, point in (
        ("phi_source", "before_m", np.broadcast_to(measured.tx_position[:2], vertex.shape)),
        ("phi", "after_m", measured.rx_position[single[bent]]),
    ):
        off = point - vertex
        cross = along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0]
        shape[name][bent] = np.arctan2(cross, (along * off).sum(axis=1)) % (2 * np.pi)
        shape[length][bent] = np.linalg.norm(off, axis=1)
    links = np.concatenate([single, far])
    return Cases(
        kind=np.concatenate([paths.interaction[path, 0], np.zeros(m - k)]).astype(float),
        published_db=measured.snr_db[links].max(axis=1),
        received_db=received,
        again_db=np.concatenate([again, stronger]),
        **shape,
    )


def offset_db(far: Cases) -> tuple[float, float]:
    """How much stronger the published transmitter is than ours, by links in line of sight; and their residual before.

    Raises:
        ValueError: If there are none, or all are saturated.
    """
    if not len(far):
        raise ValueError("no link in line of sight is far enough to estimate the published power.")
    plain = float(np.median(far.published_db - far.received_db))
    stronger = float(np.median(far.published_db - far.again_db))
    if plain - stronger < 0.05 * STEP_DB:
        raise ValueError("all links in line of sight are saturated: the published power cannot be estimated.")
    return STEP_DB * plain / (plain - stronger), plain


def _received_power(paths: Paths, receiver: PublicReceiver) -> Float[np.ndarray, " n"]:
    """Power of each path as the arrays receive it, at the best beam, up to a constant."""
    rx = np.sum(np.abs(receiver.sounder.rx_response(paths.aoa_az)) ** 2, axis=-1)
    tx = np.max(np.abs(receiver.sounder.tx_response(paths.aod_az)) ** 2, axis=-1)
    return paths.power * rx * tx


def _alone(
    measured: Measurements, paths: Paths, power: Float[np.ndarray, " n"], clear: Bool[np.ndarray, " r"]
) -> tuple[np.ndarray, np.ndarray]:
    """Links whose strongest path is a lone single interaction that the published estimate shows; and these paths."""
    links, chosen = [], []
    start = np.searchsorted(paths.rx, np.arange(len(clear) + 1))
    top = measured.snr_db.argmax(axis=1)
    for i in np.flatnonzero(clear & (np.diff(start) > 0)):
        some = slice(start[i], start[i + 1])
        j = start[i] + int(np.argmax(power[some]))
        if paths.order[j] != 1 or paths.interaction[j, 0] == Interaction.TRANSMISSION:
            continue
        near = _apart(paths.aoa_az[some], float(paths.aoa_az[j])) < NEAR_RAD
        near_power, others = power[some][near].sum() - power[j], power[some].sum() - power[j]
        if near_power > power[j] * 10 ** (-ALONE_DB / 10) or others > power[j] * 10 ** (-STRONGEST_DB / 10):
            continue
        if _apart(measured.aoa_az[i, top[i]][None], float(paths.aoa_az[j]))[0] < SAME_RAD:
            links.append(i)
            chosen.append(j)
    return np.array(links, np.int64), np.array(chosen, np.int64)


def _far(measured: Measurements, paths: Paths, clear: Bool[np.ndarray, " r"]) -> np.ndarray:
    """The farthest links in line of sight."""
    seen = np.zeros(len(clear), bool)
    seen[paths.rx[paths.order == 0]] = True
    distance = np.linalg.norm(measured.rx_position - measured.tx_position[:2], axis=1)
    there = np.flatnonzero(seen & clear & (measured.state == LinkState.LOS) & (distance > FAR_M))
    return there[np.argsort(-distance[there], kind="stable")][:FAR_LINKS]


def _received(
    paths: Paths,
    links: np.ndarray,
    receiver: PublicReceiver,
    seed: int,
    more_db: float,
    draws: int = DRAWS,
) -> Float[np.ndarray, " m"]:
    """SNR of the strongest estimate of some links, median of draws."""
    if not len(links):
        return np.empty(0)
    row = np.searchsorted(np.unique(links), paths.rx)
    wanted = np.isin(paths.rx, links)
    few = replace(paths.select(wanted), rx=row[wanted], rx_position=paths.rx_position[np.unique(links)])
    rays = Rays.from_paths(few)
    rays = replace(rays, gain=rays.gain * 10 ** (more_db / 20))
    got = [receiver.receive(rays, np.random.default_rng((seed, i)))[2].max(axis=1) for i in range(draws)]
    return np.median(got, axis=0)[np.searchsorted(np.unique(links), links)]


def _apart(a: Float[np.ndarray, "*n"], b: float) -> Float[np.ndarray, "*n"]:
    """Angle between directions and one [rad]."""
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi)
