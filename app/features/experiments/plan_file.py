"""Plans as YAML files: the schema, and what is wrong with a file in one sentence."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import msgspec

from ispom.errors import InputError
from ispom.io.files import exists, expanded
from ispom.io.mapping import parse_yaml, read_mapping
from ispom.methods import method, with_dependencies
from ispom.sequences import MIN_FRAMES, check_max_exposures
from ispom.sequences.address import MAX_SEED
from ispom.sequences.two_rate import MAX_FRAMES, MIN_SCALE
from ispom.settings import check, from_plain

from .options import Runs
from .plan import COVERAGE, Field, Line, Plan, Statement, Value

MAX_RUNS = 100_000


class LineEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    method: str
    settings: dict[str, Value] = {}
    note: str = ""
    sources: tuple[str, ...] = ()


class PlanEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The file: `lines` by name, or `methods` with `settings`, whose values are combined."""

    title: str
    sources: list[str]
    note: str = ""
    seeds: int | str | list[int] = 0
    lines: dict[str, LineEntry] = {}
    methods: list[str] = []
    settings: dict[str, list[Value]] = {}
    quantities: tuple[str, ...] = Plan.quantities
    statements: tuple[Statement, ...] = ()
    stereo_every: Annotated[int, msgspec.Meta(ge=1, le=MAX_FRAMES)] = 1
    video_scale: Annotated[float, msgspec.Meta(ge=MIN_SCALE, le=1)] = 1.0
    max_exposures: Annotated[int, msgspec.Meta(ge=MIN_FRAMES, le=MAX_FRAMES)] | None = None
    fields: tuple[Field, ...] = ()


def built_in() -> dict[str, Any]:
    """By name, the files of the plans that come with ISPOM."""
    folder = files(__name__.rpartition(".")[0]).joinpath("plans")
    return {Path(file.name).stem: file for file in sorted(folder.iterdir(), key=lambda f: f.name)}


def read_plan(options: Runs) -> Plan:
    """The plan that the command asks for; InputError with the place in the file for what is wrong with it."""
    known, plan_name = built_in(), options.plan
    if plan_name in known:
        plan = _plan(plan_name, plan_name, parse_yaml(plan_name, known[plan_name].read_text(encoding="utf-8")))
    elif exists(expanded(plan_name)):
        plan = _plan(Path(plan_name).stem, plan_name, read_mapping(expanded(plan_name)))
    else:
        raise InputError(f"{plan_name} is no plan of an experiment: give {', '.join(known)}, faults, or a YAML file")
    if sources := (*options.more, *options.sources):  # instead of all that the plan says of sources
        lines = tuple(replace(line, sources=()) for line in plan.lines)
        plan = replace(plan, sources=sources, lines=lines)
    plan = replace(plan, seeds=plan.seeds if options.seeds is None else seeds_of("--seeds", options.seeds))
    if options.max_exposures is not None:
        check_max_exposures(options.max_exposures)
        plan = replace(plan, max_exposures=options.max_exposures)
    runs = len(plan.sources) * len(plan.seeds) * len(plan.lines)
    if runs > MAX_RUNS:
        raise InputError(f"{plan_name} asks for {runs} runs, more than {MAX_RUNS}: split it")
    folders = [run.folder for run in plan.runs()]
    if len(set(folders)) < len(folders):
        raise InputError(
            f"{plan_name} has two lines or sources of almost the same name: give them names that differ more"
        )
    return plan


def _plan(name: str, where: str, content: Any) -> Plan:
    try:
        entry = msgspec.convert(content, PlanEntry)
    except msgspec.ValidationError as error:
        raise InputError(f"{where}: {error}: correct it") from None
    lines = _lines(where, entry)
    known = {line.name for line in lines}
    for statement in entry.statements:
        for line in filter(None, (statement.line, statement.over_line)):
            if line not in known:
                raise InputError(
                    f"{where}: a statement is about line {line!r}, which is none of the plan's: correct it"
                )
    for field in entry.fields:
        if field.line not in known:
            raise InputError(f"{where}: a field is of line {field.line!r}, which is none of the plan's")
    for line in lines:
        if unknown := [source for source in line.sources if source not in entry.sources]:
            raise InputError(f"{where}: line {line.name!r} has the source {unknown[0]!r}, which is none of the plan's")
    if not entry.sources or not lines:
        raise InputError(f"{where} has no {'lines or methods' if entry.sources else 'sources'}: add some")
    return Plan(
        name,
        entry.title,
        tuple(entry.sources),
        seeds_of(f"{where}: seeds", entry.seeds),
        lines,
        entry.note,
        (*entry.quantities, *(() if COVERAGE in entry.quantities else (COVERAGE,))),
        entry.statements,
        entry.stereo_every,
        entry.video_scale,
        entry.max_exposures,
        entry.fields,
    )


def _lines(where: str, entry: PlanEntry) -> tuple[Line, ...]:
    """Those that are named, then every method with every combination of the values that it takes."""
    found = [
        Line(name, line.method, _settings(where, line.method, line.settings), line.note, line.sources)
        for name, line in entry.lines.items()
    ]
    for key in entry.settings:
        if not any(_owner(key) in with_dependencies([method(name).name]) for name in entry.methods):
            raise InputError(f"{where}: settings has {key!r}, which is no setting of its methods: METHOD.SETTING")
    for name in entry.methods:
        keys = [key for key in entry.settings if _owner(key) in with_dependencies([name])]
        for values in product(*(entry.settings[key] for key in keys)):
            chosen = dict(zip(keys, values, strict=True))
            words = [f"{key.removeprefix(f'{name}.')} {_text(value)}" for key, value in chosen.items()]
            found.append(Line(", ".join([name, *words]), name, _settings(where, name, chosen)))
    return tuple(found)


def _settings(where: str, name: str, values: dict[str, Value]) -> tuple[tuple[str, Value], ...]:
    """Checked: each a setting of the method or of one that it asks, of the right type and within its range."""
    allowed, found = with_dependencies([method(name).name]), []
    for key, value in values.items():
        owner, setting = _owner(key), key.rpartition(".")[2].replace("-", "_")
        if owner not in allowed:
            raise InputError(f"{where}: {key!r} is no setting of {name}: give METHOD.SETTING of {', '.join(allowed)}")
        config = from_plain(method(owner).config, {setting: value}, f"{where}: {owner}")
        check(config, f"{owner}.")
        found.append((f"{owner}.{setting}", getattr(config, setting)))
    return tuple(found)


def _owner(key: str) -> str:
    return key.rpartition(".")[0]


def _text(value: Value) -> str:
    return {True: "on", False: "off"}[value] if isinstance(value, bool) else str(value)


def seeds_of(where: str, seeds: int | str | list[int]) -> tuple[int, ...]:
    """0-9 or 3,5,8 or a list; each once, in order."""
    words = [str(v) for v in seeds] if isinstance(seeds, list) else str(seeds).split(",")
    found: set[int] = set()
    for word in words:
        first, _, last = word.strip().partition("-")
        if not first.isdecimal() or (last and not last.isdecimal()) or max(len(first), len(last)) > 10:
            raise InputError(f"{where}: {word[:40]!r} is no seed: give such as 0-9 or 3,5,8")
        low, high = int(first), int(last or first)
        if not low <= high <= MAX_SEED or high - low >= MAX_RUNS:
            raise InputError(f"{where}: {word[:40]!r} is no range of seeds from 0 to {MAX_SEED}: give such as 0-9")
        found |= set(range(low, high + 1))
    if not found:
        raise InputError(f"{where} is empty: give such as 0-9 or 3,5,8")
    return tuple(sorted(found))
