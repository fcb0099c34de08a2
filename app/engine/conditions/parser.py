"""Conditions over the quantities of a frame, such as `stereo.inliers < 30 and changed(stereo.status)`.

Python parses the text; of its tree only the nodes handled here are accepted, and each becomes a function of two rows.
Python never evaluates the text. A missing quantity makes the comparison, or the function, that it stands in false.
"""

from __future__ import annotations

import ast
import operator
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from keyword import iskeyword
from typing import Any, NoReturn

from ispom.errors import InputError

from ..history.quantities import NO_ROW, Row
from ..history.quantities import known as finite_or_none
from ..history.quantity import Kind, Quantity, Value

Evaluate = Callable[[Row, Row], Value]
"""The value at a frame, of its row and the row of the frame before."""
LONGEST = 1_000
"""Characters of a condition."""
DEEPEST = 100
"""Operations inside each other; each term of a sum counts."""
LARGEST = 1e15
FUNCTIONS: Mapping[str, tuple[Kind | None, Kind]] = {
    "abs": ("number", "number"),
    "increased": ("number", "flag"),
    "changed": (None, "flag"),
}
"""By name: the kind of the argument (None: any), and of the result."""
KINDS: Mapping[Kind, str] = {"number": "a number", "flag": "a condition", "text": "a text"}
RELATIONS = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
OPERATORS = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv}
USABLE = "use names such as stereo.status, numbers, quoted texts, and, or, not, + - * / ( ) < <= > >= == !="


@dataclass(frozen=True)
class Expression:
    """A condition, or a number, that has a value at every frame."""

    text: str
    quantities: tuple[Quantity, ...]
    """The quantities that the expression names, each once, from left to right."""
    value: Evaluate = field(compare=False, repr=False)

    @property
    def methods(self) -> frozenset[str]:
        """Methods whose quantities the expression names; "" where it names one of the frame itself."""
        return frozenset(quantity.method for quantity in self.quantities)


def parse(text: str, known: Mapping[str, Quantity]) -> Expression:
    """Returns the condition. InputError in one sentence, with the column of the first mistake, for any other text."""
    found = _parsed(text, known, "flag")
    if not found.quantities:
        raise _mistake(1, "it names nothing that changes: name something such as stereo.status")
    return found


def parse_number(text: str, known: Mapping[str, Quantity]) -> Expression:
    """The same for a text that gives a number, such as `stereo.inliers / 2`."""
    return _parsed(text, known, "number")


def _mistake(column: int, what: str) -> InputError:
    return InputError(f"column {column} of the expression: {what}")


def _parsed(text: str, known: Mapping[str, Quantity], kind: Kind) -> Expression:
    reader = _Reader(text, known)
    value = reader.read(reader.tree(), kind)
    return Expression(text, tuple(dict.fromkeys(reader.quantities)), value)


class _Reader:
    """Turns the nodes of one text into functions."""

    def __init__(self, text: str, known: Mapping[str, Quantity]) -> None:
        if len(text) > LONGEST:
            raise _mistake(LONGEST + 1, f"it has {len(text)} characters: give at most {LONGEST}")
        self._text, self._known = text, known
        self.quantities: list[Quantity] = []
        self._depth = 0
        self._compares_frames = False
        """Whether the node is inside `changed` or `increased`, which cannot be nested: they know one frame before."""

    def tree(self) -> ast.expr:
        text = re.sub(r"\s", " ", self._text)
        for name in sorted(self._known, key=len, reverse=True):
            if not all(part.isidentifier() and not iskeyword(part) for part in name.split(".")):  # such as orb-slam.x
                text = re.sub(rf"(?<![\w.]){re.escape(name)}(?!\w)", "_" * len(name), text)
        if strange := re.search(r"[^ -~]|[\\#]", text):  # ASCII: columns of Python's parser count bytes
            raise _mistake(strange.start() + 1, f"{strange.group()!r} cannot stand here: {USABLE}")
        margin = len(text) - len(text.lstrip())
        try:
            with warnings.catch_warnings(action="ignore"):  # of `30and`
                parsed = ast.parse(text.lstrip(), mode="eval").body
        except SyntaxError as error:
            column = min(margin + max(error.offset or 1, 1), len(text) + 1)
            if re.match("=(?!=)", text[column - 1 :]):
                raise _mistake(column, "= compares nothing: write ==") from None
            raise _mistake(column, f"{error.msg.partition(' (detected')[0].partition('. ')[0]}: {USABLE}") from None
        except (RecursionError, MemoryError):
            raise _mistake(1, "it is nested too deep: write it flatter") from None
        for node in ast.walk(parsed):
            if isinstance(node, ast.expr):
                node.col_offset += margin
                node.end_col_offset = (node.end_col_offset or 0) + margin
        return parsed

    def read(self, node: ast.expr, *kinds: Kind) -> Evaluate:
        """Returns the function of a node whose value must be of one of these kinds."""
        kind, value = self._any(node)
        if kind not in kinds:
            self._refuse(node, f"this is {KINDS[kind]}, where {' or '.join(KINDS[k] for k in kinds)} is needed")
        return value

    def _any(self, node: ast.expr) -> tuple[Kind, Evaluate]:
        self._depth += 1
        if self._depth > DEEPEST:
            self._refuse(node, f"it is nested more than {DEEPEST} deep: write it flatter")
        found = self._of(node)
        self._depth -= 1
        return found

    def _of(self, node: ast.expr) -> tuple[Kind, Evaluate]:
        match node:
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
                if number > LARGEST:
                    self._refuse(node, f"{self._source(node)} is too large: give at most {LARGEST:g}")
                return "number", lambda now, before: float(number)
            case ast.Constant(value=str()) if self._source(node)[1:-1] == node.value:
                return "text", lambda now, before: str(node.value)
            case ast.Name() | ast.Attribute():
                return self._name(node)
            case ast.BoolOp(op=op, values=values):
                parts, joined = [self.read(part, "flag") for part in values], all if isinstance(op, ast.And) else any
                return "flag", lambda now, before: joined(part(now, before) is True for part in parts)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                condition = self.read(operand, "flag")
                return "flag", lambda now, before: condition(now, before) is not True
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return "number", _applied(operator.neg, self.read(operand, "number"))
            case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
                operands = self.read(left, "number"), self.read(right, "number")
                return "number", _applied(OPERATORS[type(op)], *operands)
            case ast.Compare():
                return "flag", self._comparison(node)
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in FUNCTIONS:
                return FUNCTIONS[name][1], self._call(node, name, argument)
        self._refuse(node, f"{self._source(node)[:60]} cannot stand here: {USABLE}")

    def _comparison(self, node: ast.Compare) -> Evaluate:
        sides = [node.left, *node.comparators]
        read = [self._any(side) for side in sides]
        pairs = []
        for i, relation in enumerate(map(type, node.ops)):
            if relation not in RELATIONS:
                self._refuse(node, f"{self._source(node)[:60]} cannot stand here: {USABLE}")
            (kind, left), (other, right) = read[i : i + 2]
            if relation not in (ast.Eq, ast.NotEq):
                for side, of in zip(sides[i : i + 2], (kind, other), strict=True):
                    if of != "number":
                        self._refuse(side, f"this is {KINDS[of]}, where a number is needed")
            elif kind != other:
                self._refuse(node, f"this compares {KINDS[kind]} with {KINDS[other]}: give two of a kind")
            self._require_possible(sides[i], sides[i + 1])
            self._require_possible(sides[i + 1], sides[i])
            pairs.append(_applied(RELATIONS[relation], left, right))
        return lambda now, before: all(pair(now, before) is True for pair in pairs)

    def _require_possible(self, name: ast.expr, text: ast.expr) -> None:
        quantity = self._known.get(self._source(name))
        if quantity and quantity.choices and isinstance(text, ast.Constant) and text.value not in quantity.choices:
            choices = " or ".join(quantity.choices)
            self._refuse(text, f"{quantity.name} is never {str(text.value)[:40]!r}: give {choices}")

    def _call(self, node: ast.Call, name: str, argument: ast.expr) -> Evaluate:
        takes = FUNCTIONS[name][0]
        kinds: tuple[Kind, ...] = (takes,) if takes else ("number", "flag", "text")
        if name == "abs":
            return _applied(abs, self.read(argument, *kinds))
        if self._compares_frames:
            self._refuse(node, "changed and increased cannot stand inside each other: write one of them")
        self._compares_frames = True
        value = self.read(argument, *kinds)
        self._compares_frames = False
        compare = _applied(
            operator.ne if name == "changed" else operator.gt, value, lambda _, before: value(before, NO_ROW)
        )
        return lambda now, before: compare(now, before) is True

    def _name(self, node: ast.expr) -> tuple[Kind, Evaluate]:
        name = self._source(node)
        quantity = self._known.get(name)
        if quantity is None:
            self._refuse(node, f"{name[:60]} is unknown: {_nearest(name, self._known)}")
        self.quantities.append(quantity)
        return quantity.kind, lambda now, before: now.get(quantity.method, {}).get(quantity.key)

    def _source(self, node: ast.expr) -> str:
        return self._text[node.col_offset : node.end_col_offset]

    def _refuse(self, node: ast.expr, what: str) -> NoReturn:
        raise _mistake(node.col_offset + 1, re.sub(r"\s", " ", what))


def _applied(function: Callable[..., Any], *operands: Evaluate) -> Evaluate:
    """The function's value; None where an operand is missing, or where the result is no finite number."""

    def evaluate(now: Row, before: Row) -> Value:
        values = [operand(now, before) for operand in operands]
        if any(value is None for value in values):
            return None
        try:
            return finite_or_none(function(*values))
        except ZeroDivisionError:
            return None

    return evaluate


def _nearest(name: str, known: Mapping[str, Quantity]) -> str:
    """Returns a hint with the most similar known name."""
    methods = sorted({quantity.method for quantity in known.values()} - {""}, key=len)
    method = next((m for m in reversed(methods) if name.startswith(f"{m}.")), None)
    if method is not None:
        keys = [quantity.key for quantity in known.values() if quantity.method == method]
        found = get_close_matches(name.removeprefix(f"{method}.")[:80], keys, 1, 0.6)
        plain = ", ".join(key for key in keys if "." not in key)
        return f"did you mean {method}.{found[0]}?" if found else f"{method} has {plain}"
    found = get_close_matches(name[:80], [*known, *FUNCTIONS], 1, 0.6)
    if found:
        return f"did you mean {found[0]}?"
    return f"names are METHOD.KEY, such as stereo.status, of {', '.join(sorted(methods)) or 'no method'}"
