"""The same seed gives the same answer, however the work is spread, kept or ordered.

To the bit, times apart: over processes, with the cache, without it and from it, under another order of the
interpreter's hashes, and for each letter in any order of the letters where no estimator draws over all of them.
"""

import csv
import io
import json

import pytest
from command_line import Bench

RUN = ["--trials", "2", "--readings", "5", "--seed", "7"]
ESTIMATORS = {
    "histogram": ["--estimator", "histogram", "--bins", "500"],
    "refined": ["--estimator", "refined", "--bins", "100"],
    "particle": ["--estimator", "augmented-mcl", "--particles", "200"],
}
LONGER = ("histogram", "refined", "particle")  # particles draw the most random numbers


@pytest.fixture(scope="module")
def answer(tmp_path_factory):
    """Call `bench run --json` in one folder: what it prints but for times and places, and its table of trials."""
    bench = Bench(tmp_path_factory.mktemp("answers"))

    def answer(*words, hashes="1", letters="EO"):
        bench.environment["PYTHONHASHSEED"] = hashes
        result = bench("run", *RUN, "--letters", letters, *words, "--json")
        assert result.returncode == 0, result.stderr
        printed = json.loads(result.stdout)
        folder = bench.folder / printed.pop("results")
        for name in ("seconds", "peak_memory_mb"):
            del printed[name]
        return printed, (folder / "trials.csv").read_bytes()

    return answer


@pytest.fixture(scope="module")
def first(answer):
    """Give what a histogram filter answers at first, when nothing is in the cache."""
    return answer(*ESTIMATORS["histogram"])


def rows_of(table):
    return list(csv.DictReader(io.StringIO(table.decode())))


@pytest.mark.long
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in LONGER else name for name in ESTIMATORS]
)
def test_processes_cache_and_hashes_change_no_bit(answer, first, name):
    words = ESTIMATORS[name]
    one, trials = first if name == "histogram" else answer(*words)
    other, same = answer(*words, "--jobs", "2", "--no-cache", hashes="2")
    assert same == trials
    assert {**one, "work": None} == {**other, "work": None}
    assert one["work"]["likelihood_evaluations"] == other["work"]["likelihood_evaluations"]


@pytest.mark.long
def test_the_order_of_the_letters_changes_no_trial(answer, first):
    _, trials = first
    _, turned = answer(*ESTIMATORS["histogram"], letters="OE")
    exact = ("truth", "trial", "reading_number", "touch_index", "label", "x", "y", "theta", "true_x")
    key = lambda row: (row["truth"], int(row["trial"]), int(row["reading_number"]))  # noqa: E731
    for one, other in zip(sorted(rows_of(trials), key=key), sorted(rows_of(turned), key=key), strict=True):
        assert [one[name] for name in exact] == [other[name] for name in exact]
        # Probabilities are normalised by a sum over the letters in another order.
        assert float(one["p_truth"]) == pytest.approx(float(other["p_truth"]), rel=1e-12)
