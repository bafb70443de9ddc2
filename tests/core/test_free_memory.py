"""The refusal of what would not fit in memory."""

import resource

import pytest

from tactsim.core import InputError, memory


def test_what_fits_passes_and_what_does_not_is_refused_in_one_line_with_the_estimate(monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda: 4e9)
    memory.require(4e9, "5 letters", "choose fewer")
    with pytest.raises(
        InputError, match=r"5 letters would take about 12\.8 GB .* 4\.0 GB are free; choose"
    ) as caught:
        memory.require(12.8e9, "5 letters", "choose fewer")
    assert "\n" not in str(caught.value)


def test_the_least_of_all_limits_counts(monkeypatch):
    free = memory.free_memory()
    assert 0 < free < float("inf")
    used = memory._text(memory.Path("/proc/self/statm")).split()[0]
    limit = int(used) * resource.getpagesize() + 1_000_000
    monkeypatch.setattr(resource, "getrlimit", lambda which: (limit, limit))
    assert 0 <= memory.free_memory() <= 1_000_000
