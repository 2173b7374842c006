"""Running networks stores and sends nothing."""

import os
import subprocess
import sys
from pathlib import Path

#: One frame through the shipped mapper.
CODE = """
import numpy as np
from robosim.support.installation import shipped_network
from slam.networks.features import N_CHANNELS
from slam.networks.files import load_mapper
network, _ = load_mapper(shipped_network("mapper"))
network(np.zeros((1, N_CHANNELS, 64, 64), np.float32))
"""


def test_no_telemetry_is_stored(tmp_path):
    """Neither an identifier of the machine nor what waits to be sent; a server that runs tests is no exception."""
    environment = {
        "PATH": os.environ["PATH"],
        "HOME": str(tmp_path),
        "XDG_CACHE_HOME": str(tmp_path / "caches"),
        "PYTHONPATH": os.pathsep.join(sys.path),
    }
    subprocess.run([sys.executable, "-c", CODE], env=environment, check=True)
    files = [path for path in Path(tmp_path).rglob("*") if path.is_file()]
    assert not [path for path in files if "onnx" in str(path).lower() or "microsoft" in str(path).lower()]
