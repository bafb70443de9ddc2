"""Frozen tasks: what is asked of a method, so that results of different people can stand beside each other.

Lives here: the tasks, a file `NAME.toml` each, and what reads them, hashes the data that they give and says who is
best. Does not live here: how a run is done, which is the same with and without a task.
"""

from tactsim.bench.tasks.task import Task, names, task

__all__ = ["Task", "names", "task"]
