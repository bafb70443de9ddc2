"""Say at the end how much processor time the tests took, by folder and, with --dearest N, the N that took most."""

import os
from collections import Counter

import pytest

REST = "start and collection"


class ProcessorTime:
    """Measure the processor time of every test, s, in all processes that pytest-xdist may have started.

    A child process counts in the test that waits for its end.
    """

    def __init__(self):
        self.seconds = Counter()  # by folder
        self._of_tests = Counter()
        self._has_workers = False

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item):
        before = _used()
        result = yield
        used = _used() - before
        self.seconds["/".join(item.nodeid.split("/")[:2])] += used
        self._of_tests[item.nodeid] += used
        return result

    def pytest_sessionfinish(self, session):
        times = os.times()
        if self._has_workers:
            self.seconds[REST] += times.user + times.system
        else:
            self.seconds[REST] = _used() - sum(self.seconds.values())
        if hasattr(session.config, "workeroutput"):
            session.config.workeroutput["processor_time"] = (dict(self.seconds), dict(self._of_tests))

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node):
        self._has_workers = True
        of_folders, of_tests = getattr(node, "workeroutput", {}).get("processor_time", ({}, {}))
        self.seconds.update(of_folders)
        self._of_tests.update(of_tests)

    def pytest_terminal_summary(self, terminalreporter, config):
        for test, seconds in self._of_tests.most_common(config.getoption("--dearest")):
            terminalreporter.write_line(f"{seconds:8.1f} s  {test}")
        parts = [f"{name} {seconds:.0f}" for name, seconds in self.seconds.most_common()]
        terminalreporter.write_line(
            f"processor time, s: {', '.join(parts)}; in all {sum(self.seconds.values()):.0f}"
        )


def _used():
    """Give the processor time of this process and of the children whose end it has seen, s."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system
