"""Environments in Gymnasium's interface: a policy chooses where to touch, when to stop and what to say.

    import gymnasium
    import tactsim.env

    env = gymnasium.make("tactsim/letters-v1", belief="refined")

Lives here: the environments of the frozen tasks and their rewards. Reference policies: `examples/policies`.
Does not live here: how an object is pressed, what estimators believe, how a run is scored; nothing else imports this.

Importing it registers every task of `tactsim.bench.tasks` that is pressed as `tactsim/NAME`. It needs the extra `env`.
"""

try:
    import gymnasium
except ModuleNotFoundError:
    raise ModuleNotFoundError(
        "tactsim.env needs the package gymnasium: pip install 'tactsim[env]'", name="gymnasium"
    ) from None

from tactsim.bench import tasks
from tactsim.env.touch_env import Reward, TouchEnv, entropy

__all__ = ["Reward", "TouchEnv", "entropy"]


def _register() -> None:
    """Register every task that is not registered yet; what was recorded cannot be pressed."""
    for name in tasks.names():
        if tasks.task(name).pressed and f"tactsim/{name}" not in gymnasium.registry:
            gymnasium.register(
                id=f"tactsim/{name}",
                entry_point="tactsim.env.touch_env:TouchEnv",
                max_episode_steps=tasks.task(name).readings,
                kwargs={"task": name},
            )


_register()
