"""Path estimates of a receiver from a measurement: a few paths of each link, the strongest first.

The SNR of a path is that of the link budget: transmit power, gain of the path, directivities of a transmit beam and
of a receive array that look straight at it, over the noise in the signal's bandwidth. So it gives the gain of the
path, whatever the orientation of the arrays (`wireless.sounding.sounder.Sounder.gain_db`). Correlation with the
waveform adds 33 dB for 2048 samples: paths are found down to some -25 dB, and 10 dB, the published limit for
trusting a path, separates strong paths from weak ones rather than from noise.

Published values (mmwRobotNav) agree with it up to some 40 dB. They count from the mean of the whole measurement,
which strong paths are a part of, and so level off at 50 to 55 dB; here a strong path reads as strong as it is.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Float, Int

from wireless.support.counting import counted
from wireless.support.listing import MOST_ROWS, Listing


@dataclass(frozen=True, kw_only=True, eq=False)
class PathEstimates:
    """Estimated paths of many links. Places beyond a link's count hold angles and delays 0 and SNR -inf."""

    aoa_rad: Float[np.ndarray, "links paths"]
    """Azimuth of arrival in the receiver's frame, in [-pi, pi)."""
    aod_rad: Float[np.ndarray, "links paths"]
    """Azimuth of departure in the transmitter's frame, in [-pi, pi); NaN if the transmitter has a single beam."""
    snr_db: Float[np.ndarray, "links paths"]
    """SNR by the link budget, before correlation; falls along the paths."""
    delay_s: Float[np.ndarray, "links paths"]
    """Delay after the strongest path; negative for earlier ones; NaN if the bandwidth does not resolve delays."""
    count: Int[np.ndarray, " links"]
    """Number of paths found."""

    def __len__(self) -> int:
        return len(self.count)

    def __repr__(self) -> str:
        return f"<PathEstimates: {self._summary()}>"

    def __str__(self) -> str:
        return self._listing().text()

    def _repr_html_(self) -> str:
        return self._listing().html()

    def __getitem__(self, links: slice) -> "PathEstimates":
        """Return the estimates of a slice of the links."""
        return replace(self, **{f.name: getattr(self, f.name)[links] for f in fields(self)})

    def _summary(self) -> str:
        """How many paths of what."""
        without = (self.count == 0).sum()
        paths = counted(int(self.count.sum()), "estimated path")
        return f"{paths} of {counted(len(self), 'link')}, {without} of them without any"

    def _listing(self) -> Listing:
        """The first estimates as a table, in degrees and nanoseconds."""
        places = np.argwhere(np.arange(self.aoa_rad.shape[1]) < self.count[:, None])
        rows = [
            (
                str(link),
                str(path),
                f"{np.degrees(self.aoa_rad[link, path]):.1f}",
                f"{np.degrees(self.aod_rad[link, path]):.1f}",
                f"{self.snr_db[link, path]:.1f}",
                f"{1e9 * self.delay_s[link, path]:.2f}",
            )
            for link, path in places[:MOST_ROWS]
        ]
        heads = ("link", "path", "AoA az [deg]", "AoD az [deg]", "SNR [dB]", "delay [ns]")
        return Listing(title=self._summary(), heads=heads, rows=rows, n_rows=len(places))

    def turned(
        self,
        *,
        rx_heading_rad: float | Float[np.ndarray, " links"] = 0.0,
        tx_heading_rad: float | Float[np.ndarray, " links"] = 0.0,
    ) -> "PathEstimates":
        """Return these estimates with azimuths in the scene's frame.

        Args:
            rx_heading_rad: Azimuth in the scene of the receiver's own +x, as the receiver believes it.
            tx_heading_rad: Likewise of the transmitter.
        """
        is_path = np.arange(self.aoa_rad.shape[1]) < self.count[:, None]
        turn_rx = np.broadcast_to(np.asarray(rx_heading_rad, float), len(self))[:, None]
        turn_tx = np.broadcast_to(np.asarray(tx_heading_rad, float), len(self))[:, None]
        return replace(
            self,
            aoa_rad=np.where(is_path, wrapped(self.aoa_rad + turn_rx), 0.0),
            aod_rad=np.where(is_path, wrapped(self.aod_rad + turn_tx), 0.0),
        )


def measured(
    **columns: Float[np.ndarray, "links paths"],
) -> dict[str, Float[np.ndarray, "links paths"] | None]:
    """Columns of estimates by name, with None for those that a measurement does not resolve (NaN)."""
    return {name: None if np.isnan(values).any() else values for name, values in columns.items()}


def wrapped(angle_rad: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch"]:
    """Wrap angles to [-pi, pi)."""
    return (angle_rad + np.pi) % (2 * np.pi) - np.pi
