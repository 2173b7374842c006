"""Random numbers of their own for each source of noise, so that a new source changes no other."""

import zlib

import numpy as np


def named_generator(parent: np.random.Generator, name: str) -> np.random.Generator:
    """Make the generator of a source of noise from a parent's seed and the source's name.

    The parent draws nothing, and its children of `spawn` are others.
    """
    seed = parent.bit_generator.seed_seq
    if not isinstance(seed, np.random.SeedSequence):
        raise ValueError("the generator was not made from a seed: make it with numpy.random.default_rng.")
    key = zlib.crc32(name.encode())
    return np.random.default_rng(np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, key)))
