"""The policy `rss`: `fused` for a robot that measures received power only, without directions.

The belief comes from all powers along the trajectory at once: a law of distance with the walls of the map between, and
shadowing that is correlated in space (`wireless.positioning.received_power`). Walls that the robot finds later change
what earlier powers mean. Where nothing is received, places from which a target would be are excluded, as for `learned`.
"""

import math
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float

from robosim.policies.belief import Around, BeliefConfig, TargetBelief
from robosim.policies.fused import Fused
from robosim.policies.route_directions import MapSurvey
from robosim.policies.sightlines import OBSTACLE, count_walls
from robosim.radio.measurement import Measurement, free_path_m
from wireless.positioning.received_power import PowerLawConfig, PowerReadings, log_evidence

#: Successive readings within this distance and turn count as one [m, rad]; most of them.
_STEP_M, _TURN_RAD, _MOST = 1.0, 0.8, 100
#: Readings after which the belief is computed again, and cells per side of one candidate.
_EVERY, _CELLS = 3, 3
#: Candidates are not looked for where the logarithm of the prior is so much less than the largest.
_UNLIKELY = 3.0
#: Standard deviation of the power at 1 m [dB].
_POWER_DB = 6.0


class PowerBelief(TargetBelief):
    """A belief from received powers."""

    def __init__(self, start: Float[np.ndarray, "2"], config: BeliefConfig | None = None) -> None:
        super().__init__(start, replace(config or BeliefConfig(), silence=True))
        one_m_db = 20 * math.log10(free_path_m(0.0, self.config.frequency_hz))
        self._law = PowerLawConfig(power_dbm=(one_m_db, _POWER_DB), above_m=(0.0,))
        self._readings: list[tuple[float, float, float, float]] = []

    def _weigh(self, measurement: Measurement, survey: MapSurvey, around: Around) -> None:
        if not len(measurement.gain_db):
            return
        x, y, yaw = measurement.pose.tolist()
        self._readings.append((x, y, yaw, float(measurement.gain_db[0])))
        if len(self._readings) % _EVERY != 1:
            return
        table = np.array(self._readings)
        readings = PowerReadings(
            xy=table[:, :2], heading_rad=table[:, 2], power_dbm=table[:, 3], count=np.ones(len(table))
        ).thinned(_STEP_M, _TURN_RAD, _MOST)
        prior = self._prior[_CELLS // 2 :: _CELLS, _CELLS // 2 :: _CELLS]
        likely = prior > prior.max() - _UNLIKELY
        candidates = self.centres[_CELLS // 2 :: _CELLS, _CELLS // 2 :: _CELLS][likely]
        known = survey.known
        cells = known.frame.to_cells(readings.xy), known.frame.to_cells(candidates)
        evidence = log_evidence(readings, candidates, count_walls(known.kind == OBSTACLE, *cells), self._law)
        coarse = np.where(likely, np.float32(0), np.float32(evidence.min()))
        coarse[likely] = evidence
        ny, nx = self.frame.shape
        size = prior.shape[1] * _CELLS, prior.shape[0] * _CELLS
        # Cells at the edge may have no candidate.
        edges = (0, max(ny - size[1], 0)), (0, max(nx - size[0], 0))
        self._log[:] = np.pad(np.asarray(cv2.resize(coarse, size)), edges, mode="edge")[:ny, :nx]


class PowerSearch(Fused):
    """Goes to the peak of the belief from received powers, or where most of it can be seen."""

    uses_directions = False
    make_belief = PowerBelief
