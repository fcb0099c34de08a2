"""Text to expression: recursive descent over the closed grammar of `syntax`, and kinds checked on the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches

from ..history.quantity import Kind, Quantity
from .syntax import All, Any, Call, Chain, Comparison, Name, Negative, Node, Not, Number, Text, names
from .words import RESERVED, Word, mistake, words

DEEPEST = 25
"""Parentheses, not, minus and functions inside each other."""
RELATIONS = ("<", "<=", ">", ">=", "==", "!=")
FUNCTIONS: Mapping[str, tuple[Kind | None, Kind]] = {
    "abs": ("number", "number"),
    "increased": ("number", "flag"),
    "changed": (None, "flag"),
}
"""By name: the kind that it takes (None: any), and what it gives."""
CALLED: Mapping[Kind, str] = {"number": "a number", "flag": "a condition", "text": "a text"}


@dataclass(frozen=True)
class Expression:
    """A condition, or a number, that every exposure can be asked."""

    text: str
    node: Node
    quantities: tuple[Quantity, ...]
    """What it speaks of, each once, from left to right."""

    @property
    def methods(self) -> frozenset[str]:
        """Whose steps it speaks of; "" where of the exposure itself."""
        return frozenset(quantity.method for quantity in self.quantities)


def parse(text: str, known: Mapping[str, Quantity]) -> Expression:
    """The expression; InputError in one sentence, with the column of the first mistake, for any other text."""
    found = _parsed(text, known, "flag")
    if not found.quantities:
        raise mistake(1, "it names nothing that changes: name something such as stereo.status")
    return found


def parse_number(text: str, known: Mapping[str, Quantity]) -> Expression:
    """The same for a text that gives a number, such as `stereo.inliers / 2`."""
    return _parsed(text, known, "number")


def _parsed(text: str, known: Mapping[str, Quantity], kind: Kind) -> Expression:
    node = _Parser(words(text, known), known).whole(kind)
    return Expression(text, node, tuple(dict.fromkeys(names(node))))


@dataclass
class _Parser:
    """Each rule gives the node, its kind, and leaves `at` behind it."""

    words: list[Word]
    known: Mapping[str, Quantity]
    at: int = 0
    depth: int = 0
    before: bool = False
    """Whether what is read here is also asked at the exposure before."""

    @property
    def word(self) -> Word:
        return self.words[self.at]

    def whole(self, kind: Kind) -> Node:
        node = self._wanted(1, *self._condition(), kind)
        if self.word.kind != "end":
            raise mistake(self.word.column, f"{self.word} cannot stand here: join conditions with and, or")
        return node

    def _took(self, *texts: str) -> str | None:
        """The word here, where it is one of these signs or reserved names; steps behind it."""
        word = self.word
        if word.kind not in ("sign", "name") or word.text not in texts:
            return None
        self.at += 1
        return word.text

    def _wanted(self, column: int, node: Node, kind: Kind, *kinds: Kind) -> Node:
        if kind not in kinds:
            raise mistake(column, f"this is {CALLED[kind]}, where {' or '.join(CALLED[k] for k in kinds)} is needed")
        return node

    def _condition(self) -> tuple[Node, Kind]:
        return self._joined("or")

    def _joined(self, joint: str) -> tuple[Node, Kind]:
        def part() -> tuple[Node, Kind]:
            return self._joined("and") if joint == "or" else self._one()

        column = self.word.column
        node, kind = part()
        parts = [node]
        while self._took(joint):
            self._wanted(column, parts[-1], kind, "flag")
            column = self.word.column
            node, kind = part()
            parts.append(node)
        if len(parts) == 1:
            return node, kind
        self._wanted(column, node, kind, "flag")
        return (Any if joint == "or" else All)(tuple(parts)), "flag"

    def _one(self) -> tuple[Node, Kind]:
        if not self._took("not"):
            return self._comparison()
        self._deeper()
        column = self.word.column
        node = self._wanted(column, *self._one(), "flag")
        self.depth -= 1
        return Not(node), "flag"

    def _comparison(self) -> tuple[Node, Kind]:
        column = self.word.column
        left, kind = self._chain("+", "-")
        place = self.word.column
        relation = self._took(*RELATIONS)
        if relation is None:
            return left, kind
        right_column = self.word.column
        right, right_kind = self._chain("+", "-")
        if relation not in ("==", "!="):
            self._wanted(column, left, kind, "number")
            self._wanted(right_column, right, right_kind, "number")
        elif kind != right_kind:
            raise mistake(place, f"{relation} compares {CALLED[kind]} with {CALLED[right_kind]}: give two of a kind")
        self._require_possible(left, right, right_column)
        self._require_possible(right, left, column)
        if self.word.kind == "sign" and self.word.text in RELATIONS:
            raise mistake(self.word.column, "a comparison has two sides: join two comparisons with and")
        return Comparison(left, relation, right), "flag"

    def _require_possible(self, name: Node, text: Node, column: int) -> None:
        if isinstance(name, Name) and isinstance(text, Text) and name.quantity.choices:
            choices = name.quantity.choices
            if text.value not in choices:
                raise mistake(column, f"{name.quantity.name} is never {text.value[:40]!r}: give {' or '.join(choices)}")

    def _chain(self, *signs: str) -> tuple[Node, Kind]:
        def part() -> tuple[Node, Kind]:
            return self._chain("*", "/") if "+" in signs else self._factor()

        column = self.word.column
        first, kind = part()
        rest: list[tuple[str, Node]] = []
        while sign := self._took(*signs):
            self._wanted(column, first, kind, "number")
            column = self.word.column
            operand = self._wanted(column, *part(), "number")
            rest.append((sign, operand))
        return (Chain(first, tuple(rest)), "number") if rest else (first, kind)

    def _factor(self) -> tuple[Node, Kind]:
        word = self.word
        if self._took("-"):
            self._deeper()
            node = self._wanted(self.word.column, *self._factor(), "number")
            self.depth -= 1
            return Negative(node), "number"
        if self._took("("):
            return self._closed(word)
        if word.kind == "end" or word.kind == "sign" or word.text in ("and", "or", "not"):
            needed = "a number, a text, a name such as stereo.status, or ("
            raise mistake(word.column, f"{word} stands where {needed} is needed")
        self.at += 1
        if word.kind == "number":
            return Number(float(word.text)), "number"
        if word.kind == "text":
            return Text(word.text[1:-1]), "text"
        return self._call(word) if word.text in FUNCTIONS else self._name(word)

    def _call(self, word: Word) -> tuple[Node, Kind]:
        if not self._took("("):
            raise mistake(self.word.column, f"{self.word} stands where ( is needed: write {word.text}(...)")
        if self.before and word.text != "abs":
            raise mistake(word.column, "changed and increased cannot stand inside each other: write one of them")
        takes, gives = FUNCTIONS[word.text]
        column, outer = self.word.column, self.before
        self.before = outer or word.text != "abs"
        node, kind = self._closed(word)
        self.before = outer
        return Call(word.text, self._wanted(column, node, kind, takes or kind)), gives

    def _closed(self, opening: Word) -> tuple[Node, Kind]:
        """What is in parentheses, up to the closing one."""
        self._deeper()
        node, kind = self._condition()
        self.depth -= 1
        if not self._took(")"):
            raise mistake(self.word.column, f"{self.word} stands where ) is needed: see column {opening.column}")
        return node, kind

    def _deeper(self) -> None:
        self.depth += 1
        if self.depth > DEEPEST:
            raise mistake(self.word.column, f"it is nested more than {DEEPEST} deep: write it flatter")

    def _name(self, word: Word) -> tuple[Node, Kind]:
        quantity = self.known.get(word.text)
        if quantity is None:
            raise mistake(word.column, f"{word} is unknown: {_nearest(word.text, self.known)}")
        return Name(quantity), quantity.kind


def _nearest(name: str, known: Mapping[str, Quantity]) -> str:
    """What may have been meant."""
    methods = sorted({quantity.method for quantity in known.values()} - {""}, key=len)
    method = next((m for m in reversed(methods) if name.startswith(f"{m}.")), None)
    if method is not None:
        keys = [quantity.key for quantity in known.values() if quantity.method == method]
        found = get_close_matches(name.removeprefix(f"{method}.")[:80], keys, 1, 0.6)
        plain = ", ".join(key for key in keys if "." not in key)
        return f"did you mean {method}.{found[0]}?" if found else f"{method} has {plain}"
    found = get_close_matches(name[:80], [*known, *RESERVED], 1, 0.6)
    if found:
        return f"did you mean {found[0]}?"
    return f"names are METHOD.KEY, such as stereo.status, of {', '.join(sorted(methods)) or 'no method'}"
