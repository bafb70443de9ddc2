"""Which mutants of a file are made: Cosmic Ray's operators that suit formulas.

Left out is what cannot change an answer, or fails for a reason that shows nothing about the tests: see `_left_out`,
and `OPERATORS` for what is not listed (bit shifts of floats, decorators taken away).
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from cosmic_ray import plugins
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.work_item import MutationSpec, WorkItem

Place = tuple[int, int]  # line from 1, column from 0

_ARITHMETIC = [
    "Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "Pow_Mul", "FloorDiv_Mul", "Mod_FloorDiv",
    "BitAnd_BitOr", "BitOr_BitAnd", "BitXor_BitOr",
]  # fmt: skip
_COMPARISONS = [
    "Lt_LtE", "LtE_Lt", "Gt_GtE", "GtE_Gt", "Lt_Gt", "Gt_Lt", "LtE_GtE", "GtE_LtE",
    "Eq_NotEq", "NotEq_Eq", "Is_IsNot", "IsNot_Is",
]  # fmt: skip
OPERATORS = [
    *(f"core/ReplaceBinaryOperator_{pair}" for pair in _ARITHMETIC),
    *(f"core/ReplaceComparisonOperator_{pair}" for pair in _COMPARISONS),
    *(f"core/ReplaceUnaryOperator_Delete_{sign}" for sign in ("USub", "Not", "Invert")),
    "core/AddNot", "core/ReplaceTrueWithFalse", "core/ReplaceFalseWithTrue", "core/ReplaceAndWithOr",
    "core/ReplaceOrWithAnd", "core/ReplaceBreakWithContinue", "core/ReplaceContinueWithBreak",
    "core/ExceptionReplacer", "core/NumberReplacer", "core/ZeroIterationForLoop",
]  # fmt: skip


def mutants_of(path: Path) -> list[WorkItem]:
    """List all mutants of a file, always in the same order; each is named by operator and occurrence."""
    text = path.read_text(encoding="utf-8")
    tree, spans = get_ast(text), list(_left_out(ast.parse(text)))
    nodes = list(ast_nodes(tree))
    found = []
    for name in OPERATORS:
        operator = plugins.get_operator(name)()
        places = (place for node in nodes for place in operator.mutation_positions(node))
        for occurrence, (start, end) in enumerate(places):
            if not any(low <= start and end <= high for low, high in spans):
                mutation = MutationSpec(path, name, occurrence, start, end)
                found.append(WorkItem.single(f"{name} {occurrence}", mutation))
    return found


_NUMBA_TYPES = {"float32", "float64", "int64", "uint64", "types", "void"}


def _left_out(tree: ast.Module) -> Iterator[tuple[Place, Place]]:
    """Find the stretches of code that are not mutated."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            for decorator in node.decorator_list:  # dataclass, property, a kernel's signature
                yield _span(decorator)
        if isinstance(node, ast.FunctionDef) and node.returns:
            yield _span(node.returns)
        elif isinstance(node, ast.arg | ast.AnnAssign) and node.annotation:
            yield _span(node.annotation)
        elif isinstance(node, ast.Raise):  # the text of an error; that it is raised is decided elsewhere
            yield _span(node)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Field":
            yield _span(node)  # an option's default, bounds and description are choices, not formulas
    for statement in tree.body:
        names = {part.id for part in ast.walk(statement) if isinstance(part, ast.Name)}
        if isinstance(statement, ast.Assign) and names & _NUMBA_TYPES:  # a name for a type
            yield _span(statement)


def _span(node: ast.expr | ast.stmt) -> tuple[Place, Place]:
    assert node.end_lineno is not None
    assert node.end_col_offset is not None
    return (node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset)
