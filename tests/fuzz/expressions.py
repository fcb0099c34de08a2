"""`python -m tests.fuzz.expressions --count 100000`: expressions from the grammar, mutated or not, and noise. Each is a
value, or one sentence that names the place."""

from __future__ import annotations

import argparse
import random
import re
import sys

from ispom_app.engine.conditions.evaluate import holds, values
from ispom_app.engine.conditions.parser import parse
from ispom_app.engine.history.quantities import NO_ROW, Row, quantities
from ispom_app.engine.history.quantity import Value

from ispom.errors import InputError
from ispom.methods import names

KNOWN = quantities(names())
NAMES = list(KNOWN)
MEASURED = [name for name, quantity in KNOWN.items() if quantity.kind == "number"]
FLAGS = [name for name, quantity in KNOWN.items() if quantity.kind == "flag"]
PIECES = (
    *(
        "and",
        "or",
        "not",
        "abs",
        "changed",
        "increased",
        "(",
        ")",
        "<",
        "<=",
        ">",
        ">=",
        "==",
        "!=",
        "=",
        "+",
        "-",
        "*",
    ),
    *("/", "'", '"', ".", "1e308", "0", "1e-400", "9" * 400, "nan", "inf", "True", "None", "__class__", "lambda: 0"),
    *(
        "[",
        "]",
        "{",
        "}",
        "\\",
        "\x00",
        "\n",
        "é",
        "\ud800",
        "٣",
        "²",
        "１",
        "🙂",
        "exec('1')",
        "#",
        ";",
        ",",
        "%",
        "**",
    ),
)
NUMBERS = ("0", "1", "30", "0.2", ".5", "7.", "1e-3", "1E15", "123456789")
SENTENCE = re.compile(r"column [1-9][0-9]* of the expression: \S.*[^.\s]", re.DOTALL)


def condition(rng: random.Random, depth: int) -> str:
    """One that the grammar allows, but for some kinds."""
    made = rng.randrange(9 if depth > 0 else 3)
    if made == 0:
        return rng.choice(FLAGS)
    if made in (1, 2, 3):
        relation = rng.choice(("<", "<=", ">", ">=", "==", "!="))
        return f"{number(rng, depth - 1)} {relation} {number(rng, depth - 1)}"
    if made == 4:
        return f"not {condition(rng, depth - 1)}"
    if made == 5:
        return f"({condition(rng, depth - 1)})"
    if made == 6:
        return f"{rng.choice(('changed', 'increased'))}({rng.choice((number, condition))(rng, depth - 1)})"
    joint = rng.choice((" and ", " or "))
    return joint.join(condition(rng, depth - 1) for _ in range(rng.randint(2, 3)))


def number(rng: random.Random, depth: int) -> str:
    made = rng.randrange(6 if depth > 0 else 3)
    if made == 0:
        return rng.choice(NUMBERS)
    if made in (1, 2):
        return rng.choice(MEASURED if rng.random() < 0.95 else (*NAMES, "'lost'", '"tracking"', "''"))
    if made == 3:
        return f"-{number(rng, depth - 1)}"
    if made == 4:
        return f"abs({number(rng, depth - 1)})"
    return f" {rng.choice('+-*/')} ".join(number(rng, depth - 1) for _ in range(rng.randint(2, 4)))


def mutated(rng: random.Random, text: str) -> str:
    """With pieces put in, taken out, doubled, swapped or repeated to any depth."""
    for _ in range(rng.randint(1, 4)):
        at, end = sorted((rng.randint(0, len(text)), rng.randint(0, len(text))))
        match rng.randrange(6):
            case 0:
                text = text[:at] + rng.choice(PIECES) + text[at:]
            case 1:
                text = text[:at] + text[min(end, at + 5) :]
            case 2:
                text = text[:at] + text[at:end] * rng.choice((2, 3, 50)) + text[end:]
            case 3:
                text = text[:at] + chr(rng.choice((rng.randrange(128), rng.randrange(0x110000)))) + text[at:]
            case 4:
                text = rng.choice(("(", "not ", "-", "abs(", "changed(")) * rng.choice((5, 30, 240, 5000)) + text
            case 5:
                text = text.replace(rng.choice("._aeis"), rng.choice(("", ".", " ", "A")), 1)
    return text[:20_000]


def case(seed: int) -> str:
    rng = random.Random(seed)
    if rng.random() < 0.1:
        return "".join(rng.choice((*PIECES, *NUMBERS, *NAMES[:9], " ")) for _ in range(rng.randint(0, 40)))
    text = condition(rng, rng.randint(0, 5))
    return text if rng.random() < 0.4 else mutated(rng, text)


def row(rng: random.Random) -> Row:
    """Values of the right kinds; some are missing."""
    found: dict[str, dict[str, Value]] = {}
    for quantity in KNOWN.values():
        if rng.random() < 0.8:
            number = rng.choice((0, 1, -1.5, 1e308, 5e-324, rng.gauss(0, 100)))
            text = rng.choice(quantity.choices or ("",))
            value = {"number": number, "flag": rng.random() < 0.5, "text": text}[quantity.kind]
            found.setdefault(quantity.method, {})[quantity.key] = value
    return found


ROWS = [NO_ROW, *(row(random.Random(seed)) for seed in range(5))]


def fault(text: str) -> tuple[bool, str]:
    """Whether it has a value, and what is wrong with what came out ("" if nothing)."""
    try:
        expression = parse(text, KNOWN)
    except InputError as mistake:
        told = str(mistake)
        return False, "" if SENTENCE.fullmatch(told) and told.isprintable() else f"the sentence is {told!r}"
    except Exception as error:
        return False, f"{type(error).__name__}: {error}"
    try:
        for now, before in zip(ROWS, ROWS[1:] + ROWS[:1], strict=True):
            assert isinstance(holds(expression, now, before), bool)
            assert list(values(expression, now)) == [quantity.name for quantity in expression.quantities]
    except Exception as error:
        return True, f"{type(error).__name__}: {error}"
    return True, ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--count", type=int, default=100_000, help="how many cases")
    asked = parser.parse_args()
    faults = understood = 0
    for seed in range(asked.first, asked.first + asked.count):
        text = case(seed)
        valued, wrong = fault(text)
        understood += valued
        if wrong:
            faults += 1
            sys.stdout.write(f"--- case {seed}: {text[:300]!r}\n{wrong}\n")
    sys.stdout.write(f"{asked.count} cases, {understood} with a value, {faults} faults\n")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
