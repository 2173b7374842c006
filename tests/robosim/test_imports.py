"""Importing the packages changes nothing outside of them."""

import subprocess
import sys

import pytest

#: Imports every module, and prints changes of the environment and of signal handlers. OpenCV, Gymnasium and PettingZoo
#: set variables when they are imported.
_CODE = """
import importlib, os, pkgutil, signal, sys
import cv2, gymnasium, pettingzoo
def state():
    return dict(os.environ), [signal.getsignal(number) for number in signal.valid_signals()]
before = state()
from robosim.camera.rendering.gl_systems import bind_opengl
if state() != before:
    sys.exit("gl_systems changes the environment or signal handlers")
bind_opengl()  # as `make_camera` does before it imports pyrender, which needs libGL otherwise
before = state()
for package in ("robosim", "slam", "wireless"):
    for module in pkgutil.walk_packages(importlib.import_module(package).__path__, f"{package}."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
            if state() != before:
                sys.exit(f"{module.name} changes the environment or signal handlers")
"""


def test_imports_change_no_environment_variable_and_no_signal_handler():
    """Exact: both are equal before and after the import of each module, and so is Gymnasium's registry."""
    run = subprocess.run([sys.executable, "-c", _CODE], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize(
    ("imports", "name"),
    [
        ("import gymnasium, robosim", "robosim/TargetSearch-v1"),
        ("import robosim.environments, gymnasium", "robosim/TargetSearch-v1"),
        ("import gymnasium", "robosim.environments:robosim/TargetSearch-v1"),
    ],
)
def test_registration_loads_no_simulator(imports, name):
    """The environment is found; neither the simulator nor PyTorch nor MuJoCo is loaded for it."""
    code = f"""
import sys
{imports}
assert gymnasium.envs.registration._find_spec({name!r}).max_episode_steps == 1000
assert not {{"robosim.simulator", "torch", "mujoco"}} & set(sys.modules)
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


def test_import_loads_no_gymnasium():
    """`slam` and `wireless` import leaves of `robosim.support`, and nothing that comes with environments."""
    code = "import sys, robosim, slam, wireless; assert not {'gymnasium', 'numpy'} & set(sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
