"""Environments for learning: the search for a target, for one robot or many, with the API of Gymnasium or PettingZoo.

TargetSearch         `robosim/TargetSearch-v1`, one robot
TargetSearchVector   many robots in one process, each alone in its building
TargetSearchTeam     several robots in one world, with the API of PettingZoo
sb3_vec_env          the same as a vector environment of Stable-Baselines3
SearchConfig         observations, rewards and tasks
GeneratedHomes       generated homes as a source of plans

Importing this package registers the environments with Gymnasium. `import robosim` does so too if Gymnasium has been
imported before; `gymnasium.make("robosim.environments:robosim/TargetSearch-v1")` needs no import. (Gymnasium reads no
entry points of other distributions since its version 1.0.)
"""

import gymnasium

gymnasium.register(
    id="robosim/TargetSearch-v1",
    entry_point="robosim.environments.target_search:TargetSearch",
    vector_entry_point="robosim.environments.target_search_vector:TargetSearchVector",
    max_episode_steps=1000,
)
