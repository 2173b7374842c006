"""Robots that see and hear in buildings made from floor plans.

Start reading at ``robosim.episode``: one episode, whole, on one page.
"""

import os
import sys
from importlib.metadata import version

try:
    import gymnasium
except KeyboardInterrupt:
    # As a program (its name is "-m" as long as this is loaded by `python -m robosim`) it ends without a word.
    if os.path.basename(sys.argv[0]) in ("-m", "robosim"):
        raise SystemExit(130) from None
    raise

# MuJoCo's EGL needs a newer PyOpenGL than the one that pyrender asks for: with MUJOCO_GL=egl, as many servers have it
# set, `import mujoco` would fail. Its renderer is not used here but to compare with.
if os.environ.get("MUJOCO_GL", "").lower() == "egl" and version("PyOpenGL") == "3.1.0":
    del os.environ["MUJOCO_GL"]

gymnasium.register(
    id="robosim/TargetSearch-v0", entry_point="robosim.env:TargetSearch", max_episode_steps=1000
)
