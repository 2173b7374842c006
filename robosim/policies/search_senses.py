"""What the learned search is told at each step: what a robot senses itself, as numbers of about 1 in size.

Depth along the horizon, the radio's strongest paths, the link state, odometry; and what follows from odometry alone:
where the search began, and where around it the robot has been before. All in the robot's own frame. Neither a map nor
the pose that a mapper finds is used.

    depth      64 columns from left to right, each as nearness 0.5 m / (0.5 m + d) and as distance d / 10 m, 0 for none
    paths      5, each as found, cosine and sine of the azimuth of arrival, SNR / 30 dB, delay / 30 ns, 0 for none
    state      probabilities of outage, line of sight, first order, higher order
    odometry   forward and left in steps of 0.25 m, turn in steps of 10 degrees
    trail      how often the robot was in each of 8 directions by 3 distances around it
    start      ahead and left of the robot, in 10 m; steps done, in 1000

Left out: what stands lower than the camera looks.
"""

import math

import numpy as np
from jaxtyping import Float, Float32

from slam.actions import FORWARD_M, TURN_RAD

COLUMNS, PATHS, STATES = 64, 5, 4
#: Farther surfaces count as so far [m]; nearness is one half at this distance [m].
_FAR_M, _NEAR_M = 10.0, 0.5
_SNR_DB, _DELAY_S, _MOST_DELAYS = 30.0, 30e-9, 3.0
#: Directions and outer distances [m] of the places around the robot that the trail is counted in.
_SECTORS, _RINGS_M = 8, (0.8, 2.0, 5.0)
#: Half of what is counted there, as a logarithm: e^4 visits are 1.
_TRAIL = 4.0
_PLACE_M, _STEPS = 10.0, 1000.0
INPUTS = 2 * COLUMNS + 5 * PATHS + STATES + 3 + _SECTORS * len(_RINGS_M) + 3


class SearchSenses:
    """Turns what one robot senses on one search into numbers for a network."""

    def __init__(self) -> None:
        """Begin a search."""
        self._pose = np.zeros(3)
        self._trail = np.zeros((64, 2))
        self._steps = -1

    def told(
        self,
        depth_m: Float[np.ndarray, "h w"],
        odometry: Float[np.ndarray, "3"],
        direction_rad: Float[np.ndarray, " n"],
        snr_db: Float[np.ndarray, " n"],
        delay_s: Float[np.ndarray, " n"],
        probability: Float[np.ndarray, "4"],
    ) -> Float32[np.ndarray, " k"]:
        """What the network is told of a step; to be asked once a step, the start of the search being the first.

        Args:
            depth_m: The camera's picture [m], 0 where nothing was measured.
            odometry: Measured motion since the last step in the robot's frame: dx [m], dy [m], dyaw [rad].
            direction_rad: Azimuths of arrival in the robot's frame, the strongest path first.
            snr_db: SNR of these paths [dB].
            delay_s: Their delays after the strongest [s].
            probability: Of each link state.
        """
        self._move(odometry)
        out = np.zeros(INPUTS, np.float32)
        ahead = np.minimum(_horizon(depth_m), _FAR_M)
        out[:COLUMNS] = np.where(ahead > 0, _NEAR_M / (_NEAR_M + ahead), 0.0)
        out[COLUMNS : 2 * COLUMNS] = ahead / _FAR_M
        n, at = min(len(direction_rad), PATHS), 2 * COLUMNS
        paths = out[at : at + 5 * PATHS].reshape(PATHS, 5)[:n]
        paths[:, 0] = 1
        paths[:, 1], paths[:, 2] = np.cos(direction_rad[:n]), np.sin(direction_rad[:n])
        paths[:, 3] = snr_db[:n] / _SNR_DB
        paths[:, 4] = np.clip(delay_s[:n] / _DELAY_S, -_MOST_DELAYS, _MOST_DELAYS)
        at += 5 * PATHS
        out[at : at + STATES] = probability
        at += STATES
        out[at : at + 3] = odometry / (FORWARD_M, FORWARD_M, TURN_RAD)
        at += 3
        out[at : at + _SECTORS * len(_RINGS_M)] = self._around()
        out[-3:-1] = self._own(np.zeros((1, 2)))[0] / _PLACE_M
        out[-1] = self._steps / _STEPS
        return out

    def _move(self, odometry: Float[np.ndarray, "3"]) -> None:
        """Reckon where the robot is in the frame of its start, and note it."""
        x, y, yaw = self._pose
        dx, dy, turn = (float(value) for value in odometry)
        c, s = math.cos(yaw), math.sin(yaw)
        self._pose = np.array([x + c * dx - s * dy, y + s * dx + c * dy, yaw + turn])
        self._steps += 1
        if self._steps == len(self._trail):
            self._trail = np.concatenate([self._trail, np.zeros_like(self._trail)])
        self._trail[self._steps] = self._pose[:2]

    def _own(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Points of the start's frame in the robot's: ahead, left [m]."""
        c, s = math.cos(self._pose[2]), math.sin(self._pose[2])
        return (points - self._pose[:2]) @ np.array([[c, -s], [s, c]])

    def _around(self) -> Float[np.ndarray, " n"]:
        """How often the robot was where around it: distance by distance, from behind on counter-clockwise."""
        ahead, left = self._own(self._trail[: self._steps]).T
        ring = np.searchsorted(_RINGS_M, np.hypot(ahead, left))
        sector = ((np.arctan2(left, ahead) + math.pi) * (_SECTORS / (2 * math.pi))).astype(int) % _SECTORS
        count = np.bincount(ring * _SECTORS + sector, minlength=_SECTORS * (len(_RINGS_M) + 1))
        return np.log1p(count[: _SECTORS * len(_RINGS_M)]) / _TRAIL


def _horizon(depth_m: Float[np.ndarray, "h w"]) -> Float[np.ndarray, " n"]:
    """Depth at the camera's own height: of the two rows beside the horizon, where one of them was measured [m]."""
    height, width = depth_m.shape
    columns = ((np.arange(COLUMNS) + 0.5) * (width / COLUMNS)).astype(int)
    return depth_m[(height - 1) // 2 : height // 2 + 1, columns].max(axis=0)
