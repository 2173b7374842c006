"""Environments to learn in: the search for a target, by Gymnasium's API, one robot at a time or many.

TargetSearch         `robosim/TargetSearch-v1` and -v0, one robot
TargetSearchVector   many robots in one process
sb3_vec_env          the same as a vector environment of Stable-Baselines3
SearchConfig         what robots observe, what they are rewarded for, which tasks they get
MadeHomes            invented homes as a source of plans
"""
