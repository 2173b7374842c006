"""Robots that see and hear in buildings made from floor plans.

Start reading at ``robosim.episode``: one episode, whole, on one page.
"""

import gymnasium

gymnasium.register(
    id="robosim/TargetSearch-v0", entry_point="robosim.env:TargetSearch", max_episode_steps=1000
)
