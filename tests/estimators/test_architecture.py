"""The estimators' rooms: short files, and nobody reaches into another's private parts."""

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
    *("likelihood", "occupancy", "calibrated", "tilted_mosaic", "folds", "gaussian_kernels"),
    *("force", "rendered", "sequence"),
}


def imports(path):
    """(module, name) of everything that a file imports from the estimators."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("tactsim.estimators"):
            yield from ((node.module, alias.name) for alias in node.names)


def compiles(path):
    """Whether a file has functions that are compiled."""
    tree = ast.parse(path.read_text())
    return any(
        "compiled(" in ast.unparse(d)
        for n in tree.body
        if isinstance(n, ast.FunctionDef)
        for d in n.decorator_list
    )


def test_the_files_are_found():
    assert {"registry.py", "field/field.py", "filters/histogram.py"} <= set(NAMES)


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_a_file_is_read_in_one_sitting(path):
    assert len(path.read_text().splitlines()) <= 350


@pytest.mark.parametrize("path", FILES, ids=NAMES)
def test_private_names_stay_at_home(path):
    private = [name for _, name in imports(path) if name.startswith("_")]
    assert private == []
    # Nor through an object: `other._part` where `other` is neither the object itself nor one of its class.
    reached = {
        f"{node.value.id}.{node.attr}"
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
        if node.attr.startswith("_") and not node.attr.startswith("__") and node.attr != "_replace"
        if node.value.id not in ("self", "cls")
    }
    assert reached <= {"dispatcher._cache"}  # Numba has no public way to say when a cache is stale


@pytest.mark.parametrize("path", sorted(ROOM.glob("filters/*.py")), ids=lambda path: path.name)
def test_filters_see_the_face_of_likelihoods_alone(path):
    inside = "tactsim.estimators.likelihoods"
    seen = {
        module.removeprefix(f"{inside}.") for module, _ in imports(path) if module.startswith(f"{inside}.")
    }
    seen |= {name for module, name in imports(path) if module == inside}
    assert seen <= SEEN_BY_FILTERS


COMPILED = {path for path in FILES if compiles(path)}


@pytest.mark.parametrize("path", sorted(COMPILED), ids=lambda path: path.name)
def test_compiled_files_import_nothing_else(path):
    # Otherwise an edit that has nothing to do with a kernel would have it compiled again.
    bare = {"compiling", "vectors", "bits", "between_nodes", "windows", "cone_blocks", "word_vectors"}
    modules = {module.rpartition(".")[2] for module, _ in imports(path)}
    assert modules <= bare | {one.stem for one in COMPILED}
