"""Trials in several processes: this one does what the others leave."""

import multiprocessing
import os
import time

import pytest

from tactsim.bench.in_chunks import begun
from tactsim.core import InputError

TASKS = list(range(40))


def square(tasks):
    """Square numbers; the work is how many there were, and which process did them."""
    time.sleep(0.01)
    return [(task**2, os.getpid()) for task in tasks], {"tasks": len(tasks)}


def square_here(tasks, report):
    report(0)
    part = square(tasks)
    report(len(tasks))
    return part


def refuse(tasks):
    raise InputError(f"{tasks[0]} is wrong")


def never(tasks, report):
    raise AssertionError(f"{tasks} are done here")


@pytest.mark.parametrize("jobs", [2, 3])
def test_each_task_is_done_once_and_what_they_gave_stands_in_their_order(jobs):
    told = []
    with begun(square, TASKS, jobs=jobs) as others:
        parts, work = others.finish(square_here, lambda *word: told.append(word))
    assert [value for part in parts for value, _ in part] == [task**2 for task in TASKS]
    assert work == {"tasks": len(TASKS)}
    done = [count for _, count, _ in told]
    assert done == sorted(done)
    assert done[-1] == len(TASKS)
    assert {(stage, every) for stage, _, every in told} == {("trials", len(TASKS))}
    processes = {process for part in parts for _, process in part}
    assert os.getpid() in processes
    assert len(processes) <= jobs


def test_no_more_processes_start_than_there_are_tasks():
    with begun(square, TASKS[:2], jobs=40) as others:
        assert len(multiprocessing.active_children()) == 1
        parts, work = others.finish(square_here, lambda *word: None)
    assert [value for part in parts for value, _ in part] == [0, 1]
    assert work == {"tasks": 2}


def test_neighbours_of_a_group_are_done_together():
    with begun(square, TASKS, jobs=2, group=lambda task: task // 15) as others:
        assert [len(chunk) for chunk in others.chunks] == [15, 15, 10]
        parts, _ = others.finish(square_here, lambda *word: None)
    assert [len(part) for part in parts] == [15, 15, 10]


def test_workers_begin_before_this_process_does():
    with begun(square, TASKS, jobs=2) as others:
        for future in others.futures:
            future.result(timeout=60)
        parts, work = others.finish(never, lambda *word: None)
    assert work == {"tasks": len(TASKS)}
    assert os.getpid() not in {process for part in parts for _, process in part}


def test_an_error_of_a_worker_ends_the_work_here_too():
    """Otherwise a user would read of a mistake when all other trials are done."""
    done = []

    def slow(tasks, report):
        report(0)
        time.sleep(0.2)
        done.append(tasks)
        return [], {}

    with pytest.raises(InputError, match="0 is wrong"), begun(refuse, list(range(2000)), jobs=2) as others:
        others.futures[0].exception(timeout=60)
        others.finish(slow, lambda *word: None)
    assert not done
