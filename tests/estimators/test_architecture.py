"""The estimators' rooms: nobody reaches into another's private parts."""

import ast
from pathlib import Path

import pytest

ROOM = Path(__file__).parents[2] / "estimators"
FILES = sorted(ROOM.rglob("*.py"))
NAMES = [path.relative_to(ROOM).as_posix() for path in FILES]
# What a filter may know of a likelihood: its face, the maps, the calibrated model and the mosaics that active touch and
# open set predict readings with, which readings are left out together, the density that synthesis compares with, the
# force model from which the network's training readings are rendered, and the sequences whose weight trust learns.
SEEN_BY_FILTERS = {
    *("likelihood", "occupancy", "calibrated", "tilted_mosaic", "folds"),
    *("force", "rendered", "sequence"),
}


def imports(path):
    """(module, name) of everything that a file imports from the estimators."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("tactsim.estimators"):
            yield from ((node.module, alias.name) for alias in node.names)


def test_the_files_are_found():
    assert {"registry.py", "field/field.py", "filters/histogram.py"} <= set(NAMES)


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_private_names_stay_at_home(path):
    private = [name for _, name in imports(path) if name.startswith("_")]
    assert private == []
    # Nor through an object: `other._part` where `other` is neither the object itself nor one of its class.
    reached = {
        f"{node.value.id}.{node.attr}"
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
        if node.attr.startswith("_")
        and not node.attr.startswith("__")
        and node.attr not in ("_replace", "_asdict")
        if node.value.id not in ("self", "cls")
    }
    assert reached == set()


@pytest.mark.parametrize("path", sorted(ROOM.glob("filters/*.py")), ids=lambda path: path.name)
def test_filters_see_the_face_of_likelihoods_alone(path):
    inside = "tactsim.estimators.likelihoods"
    seen = {
        module.removeprefix(f"{inside}.") for module, _ in imports(path) if module.startswith(f"{inside}.")
    }
    seen |= {name for module, name in imports(path) if module == inside}
    assert seen <= SEEN_BY_FILTERS
