"""Environments for learning: the search for a target, for one robot or many, with the API of Gymnasium.

TargetSearch         `robosim/TargetSearch-v1` and -v0, one robot
TargetSearchVector   many robots in one process
sb3_vec_env          the same as a vector environment of Stable-Baselines3
SearchConfig         observations, rewards and tasks
GeneratedHomes       generated homes as a source of plans
"""
