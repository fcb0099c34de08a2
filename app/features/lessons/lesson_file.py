"""Lessons as Markdown files: YAML front matter, a section for each step, and in it a block of YAML that says what it
sets, asks and computes. The text before the block is the question, the text after it belongs to the answer."""

from __future__ import annotations

import re
from collections.abc import Mapping
from string import Formatter
from typing import Any

import msgspec

from ispom.errors import InputError
from ispom.io.mapping import parse_yaml
from ispom.methods import Config, in_order, method
from ispom.settings import check, from_plain

from ...engine.conditions.parser import Expression, parse, parse_number
from ...engine.history.quantities import quantities
from ...engine.history.quantity import Quantity
from . import facts
from .lesson import OWN, TRACK, Ask, Choose, Draw, Fact, Lesson, Number, Option, Point, RunRequest, Step

FRONT = re.compile(r"---\r?\n(.*?)\r?\n---\r?\n(.*)", re.DOTALL)
SECTION = re.compile(r"^## +", re.MULTILINE)
FENCE = re.compile(r"^```step\r?$", re.MULTILINE)
BLOCK = re.compile(r"^```step\r?\n(.*?)^```\r?$", re.DOTALL | re.MULTILINE)
CALL = re.compile(r"([a-z_]+)\(([^()]*)\)")
NAME = re.compile(r"[a-z][a-z0-9_]*")
FORM = re.compile(r"\.\d[f%]")


class _Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    pass


class RunEntry(_Entry, frozen=True):
    """Missing entries are as in the lesson's front matter."""

    source: str | None = None
    methods: list[str] | None = None
    settings: dict[str, dict[str, Any]] | None = None


class FrontEntry(_Entry, frozen=True):
    title: str
    minutes: int
    source: str
    methods: list[str]
    settings: dict[str, dict[str, Any]] = {}


class PointEntry(_Entry, frozen=True):
    right: str
    camera: str = "video"


class DrawEntry(_Entry, frozen=True):
    curve: str
    x: str
    y: str
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    within: float


class StepEntry(RunEntry, frozen=True):
    at: int = 0
    to: int | None = None
    hidden: list[str] = []
    tools: bool = False
    choose: dict[str, str] | None = None
    number: Number | None = None
    point: PointEntry | None = None
    draw: DrawEntry | None = None
    runs: dict[str, RunEntry] = {}
    values: dict[str, str] = {}
    claims: list[str] = []


def read_lesson(name: str, text: str) -> Lesson:
    """InputError in one sentence, with the place, for what is wrong with the text."""
    found = FRONT.fullmatch(text)
    if found is None:
        raise InputError(f"lesson {name} has no front matter: begin it with a line ---, title: ..., and a line ---")
    front = _convert(f"lesson {name}, front matter", found[1], FrontEntry)
    about, *sections = SECTION.split(found[2])
    steps = tuple(_step(f"lesson {name}, step {n}", front, section) for n, section in enumerate(sections, 1))
    if not steps:
        raise InputError(f"lesson {name} has no step: add a section (## ...) with a block ```step")
    return Lesson(name, front.title, front.minutes, about.strip(), steps)


def _convert(where: str, text: str, kind: type) -> Any:
    try:
        return msgspec.convert(parse_yaml(f"{where}: its YAML", text), kind)
    except InputError:
        raise
    except (msgspec.ValidationError, ValueError) as error:
        raise InputError(f"{where}: {error}: correct it") from None


def _step(where: str, front: FrontEntry, section: str) -> Step:
    title, _, body = section.partition("\n")
    count = len(FENCE.findall(body))  # before BLOCK, which looks for the end of each: of thousands for minutes
    blocks = list(BLOCK.finditer(body)) if count == 1 else []
    if len(blocks) != 1:
        raise InputError(f"{where} has {len(blocks) if count == 1 else count} blocks ```step: give it one")
    entry = _convert(where, blocks[0][1], StepEntry)
    base = RunEntry(source=front.source, methods=front.methods, settings=front.settings)
    own = _run_request(where, base, entry)
    runs = {key: _run_request(f"{where}, run {key}", _over(base, entry), run) for key, run in entry.runs.items()}
    values, known = _values(where, entry, {OWN: own, **runs})
    step = Step(
        title.strip(),
        body[: blocks[0].start()].strip(),
        body[blocks[0].end() :].strip(),
        own,
        _question(where, entry, known, {OWN, *runs}),
        entry.at,
        entry.to,
        frozenset(entry.hidden),
        entry.tools,
        runs,
        values,
        tuple(_parsed(where, parse, text, known) for text in entry.claims),
    )
    _require_values(where, step)
    return step


def _require_values(where: str, step: Step) -> None:
    """InputError where the text after the block names something else than the step's values."""
    try:
        fields = list(Formatter().parse(step.after))
    except ValueError as error:
        raise InputError(f"{where}: the text after the block has a brace too many or too few ({error})") from None
    for _, name, form, _ in fields:
        if name is not None and (name not in step.values or not FORM.fullmatch(form or "")):
            raise InputError(f"{where}: {{{name}:{form}}} is no value with a format: write such as {{ate:.2f}}")


def _over(base: RunEntry, entry: RunEntry) -> RunEntry:
    """The entry, with the base where it says nothing: source, methods, and each setting."""
    below, own = base.settings or {}, entry.settings or {}
    settings = {name: below.get(name, {}) | own.get(name, {}) for name in below | own}
    return RunEntry(source=entry.source or base.source, methods=entry.methods or base.methods, settings=settings)


def _run_request(where: str, base: RunEntry, entry: RunEntry) -> RunRequest:
    merged = _over(base, entry)
    config = Config()
    for name, chosen in (merged.settings or {}).items():
        settings = from_plain(method(name).config, chosen, f"{where}: settings.{name}")
        check(settings, f"{name}.")
        config = config.with_settings(name, settings)
    if merged.source is None or merged.methods is None:
        raise InputError(f"{where} has no source or no methods: give both")
    return RunRequest(merged.source, in_order(tuple(method(name).name for name in merged.methods)), config)


def _values(
    where: str, entry: StepEntry, runs: Mapping[str, RunRequest]
) -> tuple[dict[str, Fact | Expression], dict[str, Quantity]]:
    """The values, and all that conditions over them may name: they and the quantities of the step's own run."""
    values: dict[str, Fact | Expression] = {}
    known = dict(quantities(runs[OWN].methods))
    for name, text in entry.values.items():
        if not NAME.fullmatch(name) or name in known:
            raise InputError(f"{where}: {name!r} is no name of a value: give small letters, each name once")
        call = _called(where, text, runs.keys(), facts.NUMBERS)
        values[name] = call or _parsed(where, parse_number, text, known)
        known[name] = Quantity("", name, "number", "")
    return values, known


def _called(where: str, text: str, runs: Any, functions: Mapping[str, Any]) -> Fact | None:
    """`function(run, argument ...)`; None for a text that calls none of these functions."""
    call = CALL.fullmatch(text.strip())
    if call is None or call[1] in ("abs", "changed", "increased"):
        return None
    function, (run, *arguments) = call[1], (part.strip() for part in call[2].split(","))
    if function not in functions:
        raise InputError(f"{where}: there is no function {function}: choose from {', '.join(sorted(functions))}")
    if run not in runs:
        raise InputError(f"{where}: {function} is asked of the run {run!r}: choose from {', '.join(runs)}")
    facts.require_arguments(f"{where}: {function}", functions[function], arguments)
    return Fact(function, run, tuple(arguments))


def _parsed(where: str, parser: Any, text: str, known: Mapping[str, Quantity]) -> Expression:
    try:
        return parser(text, known)
    except InputError as error:
        raise InputError(f"{where}: {text!r}: {error}") from None


def _question(where: str, entry: StepEntry, known: Mapping[str, Quantity], runs: set[str]) -> Ask:
    questions = [kind for kind in (entry.choose, entry.number, entry.point, entry.draw) if kind is not None]
    if len(questions) != 1:
        raise InputError(f"{where} asks {len(questions)} questions: give one of choose, number, point, draw")
    match questions[0]:
        case Number() as number:
            if number.value not in entry.values:
                raise InputError(f"{where}: {number.value!r}, which is asked for, is none of the step's values")
            return number
        case PointEntry() as point:
            return Point(point.camera, _parsed(where, parse, point.right, TRACK))
        case DrawEntry() as draw:
            curve = _called(where, draw.curve, runs, facts.CURVES)
            if curve is None:
                raise InputError(f"{where}: {draw.curve!r} is no curve: write such as step_scale_curve(this, stereo)")
            return Draw(curve, draw.x, draw.y, draw.x_range, draw.y_range, draw.within)
        case options:
            return Choose(tuple(Option(text, _parsed(where, parse, when, known)) for text, when in options.items()))
