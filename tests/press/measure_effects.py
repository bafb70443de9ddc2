"""Measure what effects that the sensor model lacks do to recognition: creep, temperature, cross-talk to neighbours.

    python tests/press/measure_effects.py

Training and test readings of five vowels have the effect; `refined`, 20 trials a letter, share right after 5 readings.
"""

from dataclasses import replace

import numpy as np

import tactsim
from tactsim import ScanOptions
from tactsim.press.scanning import scan_letters

SEEDS = (0, 1, 2)


def nothing(kpa, rng):
    return kpa


def creep(kpa, rng, share=0.15):
    """Let a reading rise by this share a decade of time, and be taken 0.1 to 100 s after touch."""
    return kpa * (1 + share * rng.uniform(-1, 2, (len(kpa), 1)))


def temperature(kpa, rng, per_kelvin=0.01, spread=10.0):
    """Let all gains fall by 1 % a kelvin, at temperatures with a deviation of 10 K from one reading to the next."""
    return kpa * np.maximum(1 - per_kelvin * spread * rng.standard_normal((len(kpa), 1)), 0)


def neighbours(kpa, rng, share=0.1):
    """Let each of the four neighbours feel this share of a taxel's load, which the taxel loses."""
    padded = np.pad(kpa.reshape(-1, 6, 6), ((0, 0), (1, 1), (1, 1)))
    beside = padded[:, :-2, 1:-1] + padded[:, 2:, 1:-1] + padded[:, 1:-1, :-2] + padded[:, 1:-1, 2:]
    return ((1 - 4 * share) * kpa.reshape(-1, 6, 6) + share * beside).reshape(kpa.shape)


def main():
    for effect in (nothing, creep, temperature, neighbours):
        right = []
        for seed in SEEDS:
            silent = ScanOptions(seed=seed, sensor={"noise": 0.0, "resolution": 0.0})
            scan, _ = scan_letters(silent)
            rng = np.random.default_rng(seed)
            felt = effect(scan.readings, rng) + rng.normal(0, 2.0, scan.readings.shape)
            scan = replace(scan, readings=np.round(felt / 0.7) * 0.7)
            run = tactsim.run(scan, estimator="refined", trials=20, readings=5, seed=seed)
            right.append(run.accuracy[4])
        print(
            f"{effect.__name__:<12} {np.mean(right):.2f}   {', '.join(f'{share:.2f}' for share in right)}",
            flush=True,
        )


if __name__ == "__main__":
    main()
