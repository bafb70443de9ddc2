"""What modules.toml names is there, and no file with formulas is forgotten."""

import pytest
from modules import faults, read_modules


def test_every_file_is_mutated_or_left_out_with_a_reason():
    modules = read_modules()
    assert list(faults(modules)) == []
    assert all(modules.left_out.values())
    # Files of every room and of the folders within are looked at.
    assert {"tactsim/core/poses.py", "tactsim/press/clip.py", "estimators/filters/grid.py"} <= set(
        modules.tests
    )


def forget(modules):
    del modules.tests["estimators/filters/grid.py"]


def list_twice(modules):
    modules.left_out["estimators/filters/grid.py"] = "dull"


def move_a_file(modules):
    modules.tests["estimators/grid.py"] = modules.tests.pop("estimators/filters/grid.py")


def move_a_test(modules):
    modules.tests["estimators/filters/grid.py"].append("tests/estimators/test_grid.py")


def take_its_tests(modules):
    modules.tests["estimators/filters/grid.py"].clear()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (forget, ["estimators/filters/grid.py is neither mutated nor left out"]),
        (list_twice, ["estimators/filters/grid.py is mutated and left out"]),
        (
            move_a_file,
            [
                "estimators/filters/grid.py is neither mutated nor left out",
                "estimators/grid.py is no file of tactsim/core, tactsim/press, estimators",
            ],
        ),
        (move_a_test, ["estimators/filters/grid.py: there is no tests/estimators/test_grid.py"]),
        (take_its_tests, ["estimators/filters/grid.py has no tests"]),
    ],
)
def test_a_list_that_is_wrong_is_noticed(change, said):
    modules = read_modules()
    change(modules)
    assert list(faults(modules)) == said


def test_a_deselected_test_that_is_gone_is_noticed():
    gone = "tests/estimators/filters/test_histogram.py::test_that_was_renamed"
    modules = read_modules()._replace(deselected=(gone,))
    assert list(faults(modules)) == [f"there is no {gone}"]
