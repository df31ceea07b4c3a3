"""What is changed in a source file: the operators of cosmic-ray, and what of a file is not code.

A mutant is one small change: another operator, comparison, constant, condition. Not mutated, since no test
could or should notice: annotations, decorators, strings, what is raised (type and text of a message), blocks
for type checkers, the layout of records (``np.dtype``) and the size of arrays, and the index 0 of a block,
which has length one.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import parso
from cosmic_ray.ast import ast_nodes
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Example, Operator
from cosmic_ray.operators.provider import OperatorProvider

Place = tuple[int, int]
"""Line from 1 and column from 0."""


class _Swap(Operator):
    """Replace one word of the code by another."""

    words: dict[str, str]
    kind: str

    def mutation_positions(self, node: Any) -> Iterator[tuple[Place, Place]]:
        if node.type == self.kind and node.value in self.words:
            yield node.start_pos, node.end_pos

    def mutate(self, node: Any, index: int) -> Any:
        node.value = self.words[node.value]
        return node

    @classmethod
    def examples(cls) -> tuple[Example, ...]:
        return tuple(Example(f"x {old} y", f"x {new} y") for old, new in cls.words.items())


def _both_ways(*pairs: tuple[str, str]) -> dict[str, str]:
    return dict(pairs) | {new: old for old, new in pairs}


class SwapAssignment(_Swap):
    """``+=`` for ``-=`` and the like, which cosmic-ray leaves alone."""

    words = _both_ways(("+=", "-="), ("*=", "/="), ("|=", "&="))
    kind = "operator"


class SwapExtremum(_Swap):
    """The smaller for the larger: bounds are made of these."""

    words = _both_ways(
        ("min", "max"), ("minimum", "maximum"), ("fmin", "fmax"), ("argmin", "argmax"), ("floor", "ceil"),
        ("any", "all"), ("amin", "amax"), ("nanmin", "nanmax"),
    )  # fmt: skip
    kind = "name"


_BINARY = (
    "Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "FloorDiv_Mul", "Mod_Mul", "Pow_Mul", "BitAnd_BitOr",
    "BitOr_BitAnd", "LShift_RShift", "RShift_LShift",
)  # fmt: skip
_COMPARISONS = (
    "Lt_LtE", "Lt_GtE", "LtE_Lt", "LtE_Gt", "Gt_GtE", "Gt_LtE", "GtE_Gt", "GtE_Lt", "Eq_NotEq", "NotEq_Eq",
    "Is_IsNot", "IsNot_Is",
)  # fmt: skip
_OTHERS = (
    "ReplaceUnaryOperator_Delete_USub", "ReplaceUnaryOperator_Delete_Not",
    "ReplaceUnaryOperator_Delete_Invert", "AddNot",
    "ReplaceTrueWithFalse", "ReplaceFalseWithTrue", "ReplaceAndWithOr", "ReplaceOrWithAnd",
    "ReplaceBreakWithContinue", "ReplaceContinueWithBreak", "NumberReplacer", "ZeroIterationForLoop",
)  # fmt: skip
_PROVIDER = OperatorProvider()
OPERATORS: dict[str, Operator] = {
    name: _PROVIDER[name]()
    for name in (
        *(f"ReplaceBinaryOperator_{each}" for each in _BINARY),
        *(f"ReplaceComparisonOperator_{each}" for each in _COMPARISONS),
        *_OTHERS,
    )
} | {each.__name__: each() for each in (SwapAssignment, SwapExtremum)}
"""Name -> operator. Of all the replacements that cosmic-ray has, those that are no error of type: ``a << b``
for two lengths is found by whatever runs the line, and would only make the score look better."""


@dataclass(frozen=True, order=True)
class Change:
    """Where a file can be changed: the ``occurrence``-th place of an operator."""

    line: int
    column: int
    operator: str
    occurrence: int


@dataclass(frozen=True)
class Mutant:
    """One changed file. ``before`` and ``after``: the lines that differ, without indentation."""

    file: str
    line: int
    before: str
    after: str
    text: str

    @property
    def change(self) -> str:
        """What is changed, in one line."""
        return f"`{self.before}` → `{self.after}`"


def changes(source: str) -> list[Change]:
    """Return all changes that can be made to a file, in the order of their places."""
    tree, away, double = parso.parse(source), list(_not_code(source)), set(_negated_anyway(source))
    counts = dict.fromkeys(OPERATORS, 0)
    found = []
    for node in ast_nodes(tree):
        for name, operator in OPERATORS.items():
            for place, (start, _) in enumerate(operator.mutation_positions(node)):
                skipped = (name == "AddNot" and start in double) or (place > 0 and _is_index_zero(node))
                if not (skipped or any(begin <= start < end for begin, end in away)):
                    found.append(Change(*start, name, counts[name]))
                counts[name] += 1
    return sorted(found)


def apply(file: str, source: str, change: Change) -> Mutant | None:
    """Return the changed file; ``None`` where the change leaves what it was, or nothing that can be read."""
    text = mutate_code(source, OPERATORS[change.operator], change.occurrence)
    assert text is not None, f"{file} has no such place: {change}"
    if change.operator == "NumberReplacer":
        text = _without_space(text, change)
    try:
        if ast.dump(ast.parse(text)) == _meaning(source):
            return None
    except SyntaxError:
        return None
    old, new = source.splitlines(), text.splitlines()
    same = next(i for i, (a, b) in enumerate(zip(old, new, strict=False)) if a != b)
    rest = next(i for i, (a, b) in enumerate(zip(old[::-1], new[::-1], strict=False)) if a != b)
    before, after = (" ".join(" ".join(x[same : len(x) - rest]).split()) for x in (old, new))
    return Mutant(file, same + 1, before, after, text)


@lru_cache(maxsize=4)
def _meaning(source: str) -> str:
    return ast.dump(ast.parse(source))


def _without_space(text: str, change: Change) -> str:
    """Take out the space that cosmic-ray puts before a number."""
    lines = text.splitlines(keepends=True)
    line = lines[change.line - 1]
    lines[change.line - 1] = line[: change.column] + line[change.column :].removeprefix(" ")
    return "".join(lines)


def _not_code(source: str) -> Iterator[tuple[Place, Place]]:
    """Yield from where to where a file has what is not mutated."""
    lines = source.splitlines()
    for node in ast.walk(ast.parse(source)):
        for part in _parts_away(node):
            assert part.end_lineno is not None and part.end_col_offset is not None
            begin = _place(lines, part.lineno, part.col_offset)
            yield begin, _place(lines, part.end_lineno, part.end_col_offset)


def _negated_anyway(source: str) -> Iterator[Place]:
    """Yield the conditions that the operators for comparisons and ``not`` negate too."""
    lines = source.splitlines()
    for node in ast.walk(ast.parse(source)):
        test = node.test if isinstance(node, ast.If | ast.While | ast.IfExp | ast.Assert) else None
        compared = isinstance(test, ast.Compare) and len(test.ops) == 1
        if (compared and not isinstance(test.ops[0], ast.In | ast.NotIn)) or (
            isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not)
        ):
            yield _place(lines, test.lineno, test.col_offset)


def _place(lines: list[str], line: int, column: int) -> Place:
    """Columns of ``ast`` count bytes, those of parso characters."""
    return line, len(lines[line - 1].encode()[:column].decode())


def _parts_away(node: ast.AST) -> Iterator[Any]:
    """Yield the parts of a node that are not mutated."""
    if isinstance(node, ast.Raise | ast.JoinedStr) or (
        isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")
    ):
        yield node
    elif isinstance(node, ast.arg | ast.AnnAssign) and node.annotation is not None:
        yield node.annotation
    elif isinstance(node, ast.Call) and ast.unparse(node.func) in ("np.dtype", "cast"):
        yield node
    elif isinstance(node, ast.Call) and ast.unparse(node.func) in ("np.zeros", "np.empty", "np.full"):
        yield from node.args[:1]
    elif isinstance(node, ast.Assign):
        for value in getattr(node.value, "elts", [node.value]):
            if isinstance(value, ast.Subscript) and isinstance(value.value, ast.Name | ast.Attribute):
                yield from _zero(value)
    elif isinstance(node, ast.Subscript) and isinstance(node.value, ast.Subscript):
        yield from _zero(node.value) if _is_field(node) else _zero(node) if _is_field(node.value) else ()
    if isinstance(node, ast.FunctionDef) and node.returns is not None:
        yield node.returns
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        yield from node.decorator_list


def _is_index_zero(node: Any) -> bool:
    """Whether a number is the index 0, which ``-1`` would leave what it is where there is one entry."""
    return node.type == "number" and node.value == "0" and node.parent.type == "trailer"


def _zero(node: ast.Subscript) -> Iterator[ast.expr]:
    """Yield the index of ``node`` if it is 0."""
    if isinstance(node.slice, ast.Constant) and node.slice.value == 0:
        yield node.slice


def _is_field(node: ast.Subscript) -> bool:
    return isinstance(node.slice, ast.Constant) and isinstance(node.slice.value, str)
