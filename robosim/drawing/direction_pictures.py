"""Plot of the measurement of one link: power over directions.

Power is that of the strongest delay, for each beam of the transmitter and each azimuth at the receiver: received by the
array that faces there, with its ports matched to a level wave, and with the gains of both antennas. True paths are
circles, the larger the stronger; estimated ones are crosses with their rank. Paths closer than a beam are received as
the sum of their fields.
"""

import numpy as np
from jaxtyping import Complex, Float
from matplotlib.axes import Axes

from robosim.support.colours import STATE_NAMES
from wireless.estimates import PathEstimates, wrapped
from wireless.paths import Paths
from wireless.sounding.sounder import Sounder

#: True paths are drawn down to this far under the strongest [dB].
SHOWN_DB = 30.0
#: Steps of the receiver's looks [deg].
STEP_DEG = 1.0
#: Pictures reach this far under the strongest power [dB], or to the noise.
RANGE_DB = 60.0


def power_over_directions(
    sounder: Sounder, tensor: Complex[np.ndarray, "window samples beams"]
) -> tuple[Float[np.ndarray, " looks"], Float[np.ndarray, "looks beams"]]:
    """Azimuths at the receiver [rad], and power received there from each beam [dBm], by the measurement of one link."""
    azimuth = np.deg2rad(np.arange(-180.0, 180.0, STEP_DEG) + STEP_DEG / 2)
    arrays = len(sounder.rx.platform.face_rad)
    signature = sounder.rx_response(azimuth).reshape(len(azimuth), arrays, -1)
    size = np.linalg.norm(signature, axis=-1)
    facing = size.argmax(axis=1)
    looks = np.arange(len(azimuth))
    match = signature[looks, facing] / size[looks, facing, None]
    ports = tensor.reshape(len(tensor), arrays, -1, tensor.shape[-1])
    power = np.empty((len(azimuth), tensor.shape[-1]))
    for array in range(arrays):
        mine = facing == array
        field = np.einsum("ap,lpb->alb", match[mine].conj(), ports[:, array])
        power[mine] = (np.abs(field) ** 2).max(axis=1)
    c = sounder.config
    return azimuth, 10 * np.log10(np.maximum(power, 1e-30)) + c.tx_power_dbm - c.snr_per_gain_db


def draw_directions(
    axes: Axes, link: Paths, sounder: Sounder, tensor: np.ndarray, found: PathEstimates
) -> None:
    """Received power over directions of arrival and departure, with true (`link`) and estimated (`found`) paths."""
    azimuth, power = power_over_directions(sounder, tensor)
    order = np.argsort(sounder.tx.beam_rad)
    order = np.append(order, order[0])  # the circle of beams closes
    beam = np.rad2deg(np.unwrap(sounder.tx.beam_rad[order]))
    top = float(power.max())
    noise = sounder.config.tx_power_dbm - sounder.config.snr_per_gain_db
    image = axes.pcolormesh(
        np.rad2deg(azimuth), beam, power[:, order].T, shading="nearest", cmap="cividis",
        vmin=max(noise, top - RANGE_DB), vmax=top, rasterized=True,
    )  # fmt: skip
    axes.figure.colorbar(image, ax=axes, label="received power [dBm]", extend="min")
    under = link.power_db.max(initial=-np.inf) - link.power_db
    shown = under <= SHOWN_DB
    axes.scatter(
        np.rad2deg(wrapped(link.aoa_az[shown])),
        np.rad2deg(wrapped(link.aod_az[shown])),
        s=160 * (1 - under[shown] / SHOWN_DB) + 12,
        facecolor="none",
        edgecolor="white",
        linewidth=1.3,
        label=f"true path, down to {SHOWN_DB:g} dB under the strongest",
    )
    n = int(found.count[0])
    aoa, aod = np.rad2deg(found.aoa_rad[0, :n]), np.rad2deg(found.aod_rad[0, :n])
    axes.plot(aoa, aod, "x", color="#D55E00", ms=9, mew=2.2, label="estimated path, by rank")
    for i in range(n):
        axes.annotate(
            f"{i + 1}", (aoa[i], aod[i]), (6, 5), textcoords="offset points", color="#D55E00", weight="bold"
        )
    axes.set(xlim=(-180, 180), ylim=(-180, 180))
    axes.set(xticks=range(-180, 181, 60), yticks=range(-180, 181, 60))
    axes.set_xlabel("azimuth of arrival at the receiver [degrees from +x]")
    axes.set_ylabel("azimuth of departure, by beam of the transmitter [degrees from +x]")
    state = STATE_NAMES[int(link.link_category().max())]
    axes.set_title(f"received power over directions ({state})", fontsize=10)
    axes.legend(
        loc="upper center", bbox_to_anchor=(0.5, -0.11), ncols=2, fontsize=8, frameon=True, facecolor="0.45",
        labelcolor="white",
    )  # fmt: skip
