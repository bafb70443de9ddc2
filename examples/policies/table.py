"""Compare policies on a task and print a table: `python examples/policies/table.py`.

A policy of one's own enters it so:

    from table import Policy, REFERENCES, compare

    class Middle(Policy):
        def choose(self, env, observation):
            return [0, 0, self.rng.uniform(-3, 3)]

    compare([*REFERENCES, Middle()])
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from time import process_time

import gymnasium
import numpy as np
from numpy.typing import NDArray
from policies import InformationPolicy, LearnedPolicy, Policy, RandomPolicy

from tactsim.bench.intervals import Figure, mean, share
from tactsim.bench.tasks import task as read_task
from tactsim.bench.trials import sure_enough
from tactsim.core import InputError
from tactsim.core.poses import FloatArray
from tactsim.env import Reward, TouchEnv

SURE = 0.95  # a policy stops as soon as a label is believed to be this probable
REFERENCES = (
    RandomPolicy(), RandomPolicy("force-mosaic"), InformationPolicy(), InformationPolicy("force-mosaic"),
    LearnedPolicy(),
)  # fmt: skip
_SHOWN = (1, 2, 3, 5, 10)  # touches after which a table says how many are right


@dataclass(frozen=True, eq=False)
class Played:
    """Episodes of one policy, in which it was let touch on after it would have stopped.

    right: (n, touches) whether the most probable label was the right one. sure: (n, touches) its probability. sizes:
    how many episodes each scan seed has, one after the other. choosing, learning: s of processor time, of one choice
    and of what was learned for one scan seed.
    """

    policy: Policy
    right: NDArray[np.bool_]
    sure: FloatArray
    sizes: tuple[int, ...]
    choosing: float
    learning: float

    @property
    def stopped(self) -> NDArray[np.int64]:
        """Count the touches after which each policy stops (n,): when it is sure, or after the last."""
        ends = sure_enough(self.sure, SURE)
        ends[:, -1] = True
        return ends.argmax(axis=1) + 1

    def returns(self, reward: Reward) -> FloatArray:
        """Sum up the rewards of each episode (n,), that of information left out."""
        touches = self.stopped
        right = self.right[np.arange(len(touches)), touches - 1]
        return np.where(right, reward.right, -reward.wrong) - reward.touch_cost * touches


def play(policy: Policy, task: str, scan_seeds: Sequence[int], episodes: int, touches: int) -> Played:
    """Let a policy touch `touches` times in each of `episodes` episodes a scan seed, after it learned there.

    Episode k of a scan seed hides the same object, with the same luck, from every policy.
    Raises InputError as the environment and the policy do.
    """
    shape = (len(scan_seeds), episodes, touches)
    right, sure = np.zeros(shape, dtype=bool), np.zeros(shape)
    choosing = learning = 0.0
    for i, scan_seed in enumerate(scan_seeds):
        start = process_time()
        policy.learn(task, scan_seed)
        learning += process_time() - start
        env = gymnasium.make(f"tactsim/{task}", belief=policy.belief, scan_seed=scan_seed).unwrapped
        assert isinstance(env, TouchEnv)
        for k in range(episodes):
            observation, _ = env.reset(seed=1_000_000 * scan_seed + k)
            policy.begin(np.random.default_rng([scan_seed, k]))
            for n in range(touches):
                start = process_time()
                pose = policy.choose(env, observation)
                choosing += process_time() - start
                observation, *_ = env.step(env.touch(pose))
                best = observation["probabilities"].argmax()
                right[i, k, n], sure[i, k, n] = (
                    env.labels[best] == env.answer,
                    observation["probabilities"][best],
                )
    return Played(
        policy, right.reshape(-1, touches), sure.reshape(-1, touches), (episodes,) * len(scan_seeds),
        choosing / right.size, learning / len(scan_seeds),
    )  # fmt: skip


def table(played: Sequence[Played]) -> Iterator[str]:
    """Write the lines of a Markdown table, a policy a line."""
    touches = played[0].right.shape[1]
    shown = [k for k in _SHOWN if k <= touches]
    heads = ["policy", "belief", *(f"right after {k}" for k in shown), "touches until it stops", "reward"]
    yield "| " + " | ".join([*heads, "ms a choice", "s to learn"]) + " |"
    yield "|---" * (len(heads) + 2) + "|"
    for one in played:
        cells = [_cell(share(one.right[:, k - 1], one.sizes), 2) for k in shown]
        cells.append(_cell(mean(one.stopped, one.sizes), 1))
        cells.append(_cell(mean(one.returns(Reward()), one.sizes), 2))
        learning = f"{one.learning:.0f}" if one.learning > 0.5 else "-"
        cells += [f"{1e3 * one.choosing:.1f}", learning]
        yield "| " + " | ".join([one.policy.name, one.policy.belief, *cells]) + " |"


def _cell(figure: Figure, digits: int) -> str:
    return f"{figure.value:.{digits}f} ({figure.low:.{digits}f}-{figure.high:.{digits}f})"


def compare(
    policies: Sequence[Policy] = REFERENCES,
    task: str = "letters-offgrid-v1",
    episodes: int = 40,
    touches: int = 10,
) -> None:
    """Play each policy in so many episodes for each of the task's scan seeds, and print a Markdown table.

    Raises InputError as `play` does, and where there is nothing to play.
    """
    if min(len(policies), episodes, touches) < 1:
        raise InputError("give at least one policy, one episode and one touch")
    if wrong := [one for one in policies if not isinstance(one, Policy)]:
        raise InputError(f"{wrong[0]} is no policy; give what calling a class makes, as Middle()")
    played = []
    for policy in policies:
        print(f"{policy.name}, {policy.belief} ...", file=sys.stderr)
        played.append(play(policy, task, read_task(task).seeds, episodes, touches))
    print("\n".join(table(played)))


if __name__ == "__main__":
    compare()
