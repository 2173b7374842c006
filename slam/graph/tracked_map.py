"""Map of a robot as submaps and their graph: what another robot needs to be placed on it."""

from copy import copy

import numpy as np
from jaxtyping import Float

from slam.graph.pose_graph import PoseGraph
from slam.graph.submaps import Submap, poses_of_scans
from slam.graph.tracker_config import TrackerConfig


class TrackedMap:
    """Submaps of a robot and the graph of their poses."""

    def __init__(self, config: TrackerConfig, graph: PoseGraph, submaps: list[Submap]) -> None:
        self.config, self.graph, self.submaps = config, graph, submaps

    def poses(self) -> Float[np.ndarray, "n 3"]:
        """Poses of all scans: x [m], y [m], yaw [rad] in `map`."""
        return poses_of_scans(self.graph.poses, self.submaps)

    def transformed(self, by: Float[np.ndarray, "3"]) -> "TrackedMap":
        """The map in the frame in which its frame lies at a pose, packed, without what only tracking needs."""
        submaps = [copy(submap) for submap in self.submaps]
        for submap in submaps:
            submap.pack()
        return TrackedMap(self.config, self.graph.transformed(by), submaps)
