"""Tests that `make quick` leaves out: folders, and modules with tests of more than three seconds.

Single tests carry `@pytest.mark.slow` themselves.
"""

from collections.abc import Iterable
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent
#: Folders and modules, relative to this one.
SLOW = (
    "benchmark_checks",
    "cli/test_cli.py",
    "cli/test_dataset.py",
    "cli/test_evaluate.py",
    "cli/test_furnish.py",
    "cli/test_live.py",
    "cli/test_mapper.py",
    "cli/test_markup.py",
    "cli/test_outside_parts.py",
    "cli/test_packaging.py",
    "cli/test_storeys.py",
    "cli/test_trace.py",
    "cli/test_train.py",
    "cli/test_without_torch.py",
    "docs/test_formats.py",
    "docs/test_gallery.py",
    "docs/test_learning_example.py",
    "faults",
    "fuzz",
    "robosim/building/test_furnished.py",
    "robosim/building/test_thin_walls.py",
    "robosim/camera/rendering/test_gl_systems.py",
    "robosim/datasets/test_collect.py",
    "robosim/environments/test_target_search_vector.py",
    "robosim/policies/test_fused_settings.py",
    "robosim/evaluation/test_evaluation.py",
    "robosim/generator/test_generate.py",
    "robosim/live/test_browser.py",
    "robosim/live/test_search_process.py",
    "robosim/logs/test_log_files.py",
    "robosim/policies/test_learned.py",
    "robosim/policies/test_reason.py",
    "robosim/robot/test_calibration.py",
    "robosim/support/test_cluster.py",
    "robosim/support/test_installation.py",
    "robosim/support/test_workers.py",
    "robosim/test_anchors.py",
    "robosim/test_episode.py",
    "robosim/test_lidar.py",
    "robosim/test_system_packages.py",
    "robosim/test_warm_up.py",
    "robosim/training",
    "slam/control/test_recovery.py",
    "slam/exploration",
    "slam/graph/test_tracker.py",
    "slam/learning",
    "slam/mapping/test_learned_matching.py",
    "wireless/linkstate/test_linkstate_training.py",
    "wireless/tracing/test_mesh_invariance.py",
    "wireless/tracing/test_ray_search.py",
)


def mark_slow(items: Iterable[pytest.Item]) -> None:
    """Mark the tests of slow folders and modules."""
    for item in items:
        name = item.path.relative_to(TESTS).as_posix() if item.path.is_relative_to(TESTS) else ""
        if any(name == slow or name.startswith(f"{slow}/") for slow in SLOW):
            item.add_marker(pytest.mark.slow)
