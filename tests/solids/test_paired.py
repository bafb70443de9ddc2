"""Comparing runs in space, and refusing what cannot be compared."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_space import make_space_run

from tactsim.bench.compare import compare
from tactsim.core import InputError
from tactsim.core.rigid import compose, from_vector


def test_a_run_is_not_worse_than_itself_and_a_pose_that_is_off_is_worse():
    base = make_space_run(n=40, r=3)
    assert {row.verdict for row in compare(base, base)} <= {"not told apart", ""}
    off = np.concatenate([[0.0, 0, 4], from_vector([0.3, 0, 0])])
    worse = replace(base, trials=replace(base.trials, pose=compose(off, base.trials.pose)))
    verdicts = {row.name: row.verdict for row in compare(base, worse)}
    assert verdicts["share of touches right"] == "not told apart"
    assert verdicts["surface mm @3, both right"] == verdicts["angle deg @3"] == "worse"
    back = {row.name: row.verdict for row in compare(worse, base)}
    assert back["surface mm @3, both right"] == "better"


def test_other_hidden_objects_are_refused():
    base, new = make_space_run(), make_space_run(seed=1)
    other = {"seed": 1, "objects": ["nut"], "scan": "a.npz"}
    with pytest.raises(InputError, match=r"same objects.* --objects, --seed, --scan"):
        compare(base, replace(new, config=base.config | other))


def test_files_of_one_name_and_another_shape_are_refused():
    def run_of(digest):
        base = make_space_run()
        scan = {"objects": {"wedge": {"digest": digest}}}
        return replace(
            base, config=base.config | {"shapes": ["wedge.stl"]}, about=base.about | {"scan": scan}
        )

    compare(run_of("a" * 64), run_of("a" * 64))
    with pytest.raises(InputError, match="wedge is of another shape"):
        compare(run_of("a" * 64), run_of("b" * 64))
