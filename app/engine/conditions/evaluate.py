"""The value of an expression at an exposure.

Names stand for what their method said at its latest step up to there. What is missing (a check that was not made, an
error without truth, a division by zero) makes the comparison, or the function, that it stands in false.
"""

from __future__ import annotations

import math
import operator
from typing import assert_never

from ..history.quantities import NO_ROW, Row, known
from ..history.quantity import Value
from .parser import Expression
from .syntax import All, Any, Call, Chain, Comparison, Name, Negative, Node, Not, Number, Text

_RELATIONS = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}
_SIGNS = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv}


def holds(expression: Expression, now: Row, before: Row) -> bool:
    """Whether it is true at an exposure; `before` is the row at the exposure before it."""
    return _value(expression.node, now, before) is True


def number(expression: Expression, now: Row, before: Row) -> float | None:
    """What it gives at an exposure; None where something in it is missing."""
    value = _value(expression.node, now, before)
    return None if value is None else _number(value)


def values(expression: Expression, now: Row) -> dict[str, Value]:
    """By name: what it speaks of, from left to right."""
    return {quantity.name: now.get(quantity.method, {}).get(quantity.key) for quantity in expression.quantities}


def _value(node: Node, now: Row, before: Row) -> Value:
    match node:
        case Number(value) | Text(value):
            return value
        case Name(quantity):
            return now.get(quantity.method, {}).get(quantity.key)
        case Negative(of):
            value = _value(of, now, before)
            return None if value is None else -_number(value)
        case Chain():
            return _chained(node, now, before)
        case Comparison(left, relation, right):
            a, b = _value(left, now, before), _value(right, now, before)
            return a is not None and b is not None and bool(_RELATIONS[relation](a, b))
        case Call():
            return _called(node, now, before)
        case Not(of):
            return _value(of, now, before) is not True
        case All(of):
            return all(_value(part, now, before) is True for part in of)
        case Any(of):
            return any(_value(part, now, before) is True for part in of)
        case _:
            assert_never(node)


def _chained(node: Chain, now: Row, before: Row) -> Value:
    total = _value(node.first, now, before)
    for sign, operand in node.rest:
        value = _value(operand, now, before)
        if total is None or value is None or (sign == "/" and value == 0):
            return None
        total = known(_SIGNS[sign](_number(total), _number(value)))
    return total


def _called(node: Call, now: Row, before: Row) -> Value:
    value = _value(node.of, now, before)
    if node.function == "abs":
        return None if value is None else abs(_number(value))
    earlier = _value(node.of, before, NO_ROW)
    if value is None or earlier is None:
        return False
    return value != earlier if node.function == "changed" else _number(value) > _number(earlier)


def _number(value: Value) -> float:
    """The parser has seen to it that this is one."""
    return float(value) if isinstance(value, int | float) else math.nan
