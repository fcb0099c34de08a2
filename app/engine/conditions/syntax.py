"""What an expression is made of. Chains are flat, so that only what is nested makes a tree deep.

condition  = all {"or" all}             all        = one {"and" one}         one     = "not" one | comparison
comparison = sum [("<" | "<=" | ">" | ">=" | "==" | "!=") sum]
sum        = product {("+" | "-") product}         product = factor {("*" | "/") factor}
factor     = "-" factor | number | "text" | NAME | ["abs" | "changed" | "increased"] "(" condition ")"
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ..history.quantity import Quantity


@dataclass(frozen=True)
class Number:
    value: float


@dataclass(frozen=True)
class Text:
    value: str


@dataclass(frozen=True)
class Name:
    quantity: Quantity


@dataclass(frozen=True)
class Chain:
    """Numbers, added and subtracted, or multiplied and divided, from left to right."""

    first: Node
    rest: tuple[tuple[str, Node], ...]
    """Sign (+ - * /) and operand."""


@dataclass(frozen=True)
class Negative:
    of: Node


@dataclass(frozen=True)
class Comparison:
    left: Node
    relation: str
    right: Node


@dataclass(frozen=True)
class Call:
    function: str
    """abs, changed, increased."""
    of: Node


@dataclass(frozen=True)
class Not:
    of: Node


@dataclass(frozen=True)
class All:
    of: tuple[Node, ...]


@dataclass(frozen=True)
class Any:
    of: tuple[Node, ...]


Node = Number | Text | Name | Chain | Negative | Comparison | Call | Not | All | Any


def names(node: Node) -> Iterator[Quantity]:
    """What it speaks of, from left to right."""
    match node:
        case Name(quantity):
            yield quantity
        case Chain(first, rest):
            for part in (first, *(operand for _, operand in rest)):
                yield from names(part)
        case Comparison(left, _, right):
            yield from names(left)
            yield from names(right)
        case Negative(of) | Not(of) | Call(_, of):
            yield from names(of)
        case All(of) | Any(of):
            for part in of:
                yield from names(part)
