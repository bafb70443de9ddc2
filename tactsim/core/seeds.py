"""Make one stream of random numbers for each purpose, so that no draw depends on those for another."""

from __future__ import annotations

import hashlib

import numpy as np


def stream(seed: int, *purpose: str) -> np.random.Generator:
    """Make the generator for one purpose, such as ("A", "train", "placement")."""
    key = hashlib.sha256("\0".join(purpose).encode()).digest()
    words = np.frombuffer(key, dtype="<u4").tolist()
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=words))
