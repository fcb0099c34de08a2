"""What numba finds an operator to give for operands of some types, asked once for each.

Numba asks anew wherever the operator stands, and first for what arrays of any shape would give: a tenth of all the
compilation. It also looks for the type of an operator as if it were a number first, and makes an error of that.
"""

from __future__ import annotations

import operator
from functools import wraps
from typing import Any

from numba.core import types
from numba.core.types.functions import BaseFunction
from numba.core.typing.context import BaseContext

OPERATORS = frozenset({
    operator.add, operator.sub, operator.mul, operator.truediv, operator.floordiv, operator.mod, operator.neg,
    operator.iadd, operator.isub, operator.imul, operator.itruediv, operator.lt, operator.le, operator.gt, operator.ge,
    operator.eq, operator.ne, operator.not_,
})  # fmt: skip
"""Of numbers."""
ITEMS = frozenset({operator.getitem, operator.setitem})
"""Of an array, at whole numbers."""


def remember_types() -> None:
    """Has numba look among what it found before first."""
    BaseFunction.get_call_type = remembering(BaseFunction.get_call_type)
    BaseContext.resolve_value_type = looking_up(BaseContext.resolve_value_type)


def remembering(found: Any) -> Any:
    """Such a method as `found` that is only asked for what it was not asked before."""
    known: dict[tuple[Any, ...], Any] = {}

    @wraps(found)
    def call_type(function: Any, context: Any, args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        if kws or not lasts(function.typing_key, args):
            return found(function, context, args, kws)
        asked = function, context, args  # the function itself: what is called for a signature is noted there
        if asked not in known:
            known[asked] = found(function, context, args, kws)
        return known[asked]

    return call_type


def looking_up(found: Any) -> Any:
    """Such a method as `found` that looks for an operator where numba has the types of operators."""

    @wraps(found)
    def value_type(context: Any, value: Any) -> Any:
        known = context._lookup_global(value) if isinstance(value, type(operator.add)) else None
        return found(context, value) if known is None else known

    return value_type


def lasts(asked: Any, operands: tuple[Any, ...]) -> bool:
    """Whether the answer is the same in each function, whatever its options: where no other is compiled for it."""
    if not isinstance(asked, type(operator.add)):
        return False
    if asked in OPERATORS:
        return all(map(_is_number, operands))
    if asked not in ITEMS or not isinstance(operands[0], types.Array):
        return False
    return _is_place(operands[1]) and all(map(_is_number, operands[2:]))


def _is_place(index: Any) -> bool:
    return all(map(_is_number, index)) if isinstance(index, types.UniTuple | types.Tuple) else _is_number(index)


def _is_number(found: Any) -> bool:
    """A literal, too, which is only the same as another of its value."""
    return isinstance(types.unliteral(found), types.Integer | types.Float | types.Boolean)
