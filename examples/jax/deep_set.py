"""An estimator in JAX that learns from trials: a deep set (Zaheer et al. 2017) over readings and where they were taken.

    pip install jax optax  # beside tactsim
    python deep_set.py

Each reading with its pose passes one network, their mean another, which names the letter. Trained on `Scan.batches`
of many scans: a network that is told nothing of geometry learns the 192 training poses of one scan by heart.
"""

from itertools import pairwise

import jax
import numpy as np
import optax
from pydantic import Field
from scipy.special import softmax

import tactsim
from tactsim.estimators import BatchEstimator, Options


class DeepSetOptions(Options):
    """What the network takes; each option may be given as --set NAME=VALUE."""

    hidden: int = Field(128, ge=1, le=4096, description="units of a layer")
    steps: int = Field(3000, ge=1, description="batches of 128 trials to learn from")
    readings: int = Field(10, ge=1, le=48, description="readings of a trial in training")
    seed: int = Field(0, ge=0, le=2**32 - 1, description="of the first weights and of the trials")


def layers(weights, x):
    """Pass x (..., features), of NumPy or of JAX, through linear layers with rectifiers between them."""
    for number, (matrix, offset) in enumerate(weights):
        x = (x * (x > 0) if number else x) @ matrix + offset
    return x


def features(readings, sensor_in_robot, scale):
    """Give what is seen of readings (..., taxels) at poses (..., 3)."""
    xy, angle = sensor_in_robot[..., :2] / 10, sensor_in_robot[..., 2:]
    return np.concatenate([readings / scale, xy, np.cos(angle), np.sin(angle)], axis=-1, dtype=np.float32)


def logits(weights, seen):
    """Judge the letters after each number of readings, (trials, readings, letters); seen: (trials, readings, ...)."""
    count = np.arange(1, seen.shape[1] + 1, dtype=np.float32)[:, None]
    return layers(weights[1], layers(weights[0], seen).cumsum(axis=1) / count)


def loss(weights, seen, letter):
    """Give the mean surprise at the true letter after each number of readings."""
    return optax.softmax_cross_entropy_with_integer_labels(logits(weights, seen), letter[:, None]).mean()


class DeepSet(BatchEstimator):
    """Name the letter by a network of the mean of what it makes of each reading; says nothing of the place."""

    options_type = DeepSetOptions

    def learn(self, train):
        """Train on trials drawn from the training readings."""
        options, wide, letters = self.options, self.options.hidden, len(self.labels)
        self.scale = max(train.readings.std(), 1e-9)
        rng = np.random.default_rng(options.seed)
        weights = [
            [
                (np.float32(rng.normal(0, np.sqrt(2 / m), (m, n))), np.zeros(n, np.float32))
                for m, n in pairwise(sizes)
            ]
            for sizes in ((self.taxels + 4, wide, wide, wide), (wide, wide, letters))
        ]
        adam = optax.adam(optax.cosine_decay_schedule(3e-3, options.steps))
        state = adam.init(weights)

        @jax.jit
        def step(weights, state, seen, letter):
            change, state = adam.update(jax.grad(loss)(weights, seen, letter), state)
            return optax.apply_updates(weights, change), state

        fewest = min(int((train.labels == letter).sum()) for letter in self.labels)
        batches = train.batches(128, min(options.readings, fewest), rng)
        for _, batch in zip(range(options.steps), batches, strict=False):
            seen = features(batch.readings, batch.sensor_in_robot, self.scale)
            weights, state = step(weights, state, seen, batch.letter)
        self.weights = jax.tree.map(np.asarray, weights)  # NumPy's arrays can be sent to worker processes

    def answer(self, readings, sensor_in_robot):
        """Judge the letters after each reading of many trials."""
        p = softmax(logits(self.weights, features(readings, sensor_in_robot, self.scale)), axis=-1)
        return p, np.zeros((*p.shape[:2], 3))


def pressed(seeds, letters="AEIOU"):
    """Press letters at the poses of several scans, half of which are random: one scan to train on."""
    scans = [tactsim.scan(letters=letters, seed=seed) for seed in seeds]
    parts = [(scan.readings, scan.poses, scan.labels) for scan in scans]
    return tactsim.Scan.from_arrays(*map(np.concatenate, zip(*parts, strict=True)))


if __name__ == "__main__":
    run = tactsim.run(
        tactsim.scan(seed=0), train_scan=pressed(range(1, 21)), estimator=DeepSet(DeepSetOptions()),
        trials=40, readings=20,
    )  # fmt: skip
    print("right after 1, 5, 20 readings:", *run.accuracy[[0, 4, 19]])
