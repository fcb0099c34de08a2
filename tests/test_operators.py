"""What is remembered of numba's types is what numba finds, and is only what does not depend on the function."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
import pytest
from numba import njit
from numba.core import types
from numba.core.registry import cpu_target
from numba.core.typing.context import BaseContext

import ispom.kernels  # noqa: F401 (has numba remember)
from ispom.operators import ITEMS, OPERATORS, lasts, looking_up, remembering

MATRIX = types.Array(types.float64, 2, "C")
PLACE = types.UniTuple(types.int64, 2)
NUMBERS = types.float64, types.float32, types.int64, types.int32, types.uint8, types.boolean, types.literal(3)
CASES = [(asked, (one, other)) for asked in OPERATORS - {operator.neg, operator.not_} for one in NUMBERS
         for other in NUMBERS]  # fmt: skip
CASES += [(asked, (one,)) for asked in (operator.neg, operator.not_) for one in NUMBERS]
CASES += [(operator.getitem, (MATRIX, PLACE)), (operator.getitem, (MATRIX, types.int64))]
CASES += [(operator.setitem, (MATRIX, PLACE, types.float64)), (operator.setitem, (MATRIX, PLACE, types.literal(0)))]


def test_it_is_what_numba_finds() -> None:
    context: Any = cpu_target.typing_context
    context.refresh()
    for asked, operands in CASES:
        function = context.resolve_value_type(asked)
        own = type(function).get_call_type
        plain = own.__wrapped__
        assert lasts(asked, operands)
        try:
            expected = plain(function, context, operands, {})
        except Exception as fault:
            with pytest.raises(type(fault)):
                own(function, context, operands, {})
        else:
            for _ in range(2):
                assert own(function, context, operands, {}) == expected


def test_numba_is_asked_once_where_the_answer_lasts() -> None:
    asked = list[Any]()
    context: Any = cpu_target.typing_context
    context.refresh()

    def found(function: Any, context: Any, args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        asked.append(args)
        return args

    add, call = context.resolve_value_type(operator.add), remembering(found)
    for args in ((types.int64, types.int64), (types.int64, types.float64), (MATRIX, MATRIX)):
        assert call(add, context, args, {}) == call(add, context, args, {}) == args
    assert len(asked) == 4 and asked[-2:] == [(MATRIX, MATRIX)] * 2


def test_operators_are_looked_up_and_all_else_is_left_to_numba() -> None:
    context: Any = cpu_target.typing_context
    context.refresh()
    plain = BaseContext.resolve_value_type.__wrapped__
    found = looking_up(lambda context, value: "left to numba")
    assert found(context, operator.add) == plain(context, operator.add)
    assert found(context, 3) == found(context, np.linalg.norm) == "left to numba"


@pytest.mark.parametrize("asked", [operator.add, operator.getitem, np.empty, len, abs])
def test_what_numba_compiles_a_function_for_is_asked_anew(asked: Any) -> None:
    """With the options of the kernel: one with `fastmath` is not to use what was compiled for another without."""
    assert not lasts(asked, (MATRIX, MATRIX))
    assert asked in OPERATORS | ITEMS or not lasts(asked, (types.int64, types.int64))


def test_functions_with_both_kinds_of_operators_compute_as_python_does() -> None:
    def mixed(rows: Any, k: int, x: float) -> Any:
        rows[k, 1] = x // 2 + k % 3 - (not k)
        return rows[k, 0] * 2 + -rows[0, k] / x, (rows + rows)[k], rows[k] == rows[0]

    rows = np.arange(9.0).reshape(3, 3)
    for compiled, expected in zip(njit(mixed)(rows.copy(), 2, 7.5), mixed(rows.copy(), 2, 7.5), strict=True):
        np.testing.assert_array_equal(compiled, expected)
