"""`ispom passport --verify`: compares the files of a source, repeats the run, and says what differs."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ispom.ensemble import build
from ispom.errors import InputError, printable
from ispom.io.files import confined, exists, expanded, is_below, sha256_of
from ispom.io.trajectories import read_tum
from ispom.methods import Config, method, names, with_dependencies
from ispom.sequences.recorded_sensors import AUTO, NONE
from ispom.settings import from_plain

from ...engine.options import settings_of
from ...engine.playback import Builder
from ...engine.run_folder.run_file import RunFile, read_run_file
from ...engine.run_folder.run_folder import trajectory_file
from ...engine.signals import terminable
from ...session.review.stored import OPTION, StoredSource, place_of, stored_source
from ..diff.command import machine_of
from ..diff.text import shown
from ..headless.command import played_into
from ..headless.job import Origin
from ..headless.options import Run as RunCommand
from ..report.folder import Run, read_run
from .inputs import open_same, roots_of
from .options import Passport as Options
from .outputs import outputs, spread
from .written import PASSPORT, Output, Passport, is_own, read_passport, require_no_files

DIFFERENT, CANNOT_TELL = 1, 3
"""Exit codes, as those of other commands; 0 for the same bytes."""


def verify(options: Options, builder: Builder = build) -> int:
    """Prints whether the run of a passport gives the same bytes here, and returns the exit code. Raises InputError for
    a folder that is no passport, and for a source with other files."""
    folder = expanded(options.run)
    with confined((folder,)):  # also links in it lead nowhere else
        passport = read_passport(folder)
    config, reasons = _comparable(passport)
    methods = tuple(each.method for each in passport.outputs if each.method not in reasons)
    run = passport.run_file(methods)
    require_no_files(folder / PASSPORT, run)
    source = _source(options, folder, passport, run)
    roots = roots_of(source.source, source.options.camera, source.options.sensors)
    with terminable(), TemporaryDirectory(prefix="ispom-passport-") as place:
        out = Path(place) / "run"
        with confined(source.places):
            sequence = open_same(source, passport.source, roots, passport.options.until is None)
            if methods:
                command = RunCommand(
                    source=source.source,
                    methods=methods,
                    settings=settings_of(config),
                    out=out,
                    recording=False,
                    frame=passport.options.frame,
                    until=passport.options.until,
                    **vars(source.options),
                )
                played_into(command, sequence, builder, Origin(run, folder, run.earlier) if run.forked else None)
        answers = _answers(folder, passport, read_run(out, "") if methods else None, reasons)
        notes = [*_machines(run, read_run_file(out))] if methods else []
    codes = {answer.code for answer in answers}
    _print(answers, notes)
    return DIFFERENT if DIFFERENT in codes else max(codes)


@dataclass(frozen=True)
class Answer:
    """What is said of one method."""

    method: str
    code: int
    line: str = ""
    """How far the runs are from each other, or why nobody can tell; empty for the same bytes."""


def _comparable(passport: Passport) -> tuple[Config, dict[str, str]]:
    """Returns the settings of the methods that can run here, and of each other one, why it cannot."""
    settings, reasons = dict[str, Any](), dict[str, str]()
    for name in (each.method for each in passport.outputs):
        if name not in names():
            reasons[name] = "this installation has no such method"
            continue
        try:
            chain = with_dependencies((name,))
            settings |= {n: from_plain(method(n).config, passport.config.get(n), f"config.{n}") for n in chain}
            passport.run_file((name,)).earlier  # noqa: B018 (raises)
        except InputError as fault:
            reasons[name] = str(fault)
    return Config(settings), reasons


def _source(options: Options, folder: Path, passport: Passport, run: RunFile) -> StoredSource:
    """Returns the source, as `stored_source` allows it: what a stranger's passport names is opened only where it is a
    simulation without files, or where a person names it."""
    address, own = passport.source.address, is_own(folder)
    if options.source is None and not own and not address.startswith("sim:"):
        raise InputError(
            f"{folder / PASSPORT} was not written on this machine, or was changed since, and its source was "
            f"{address[:200]}: {OPTION}"
        )
    plain = replace(run, options={**run.options, "camera": None, "sensors": str(NONE)}, own=own)
    found = stored_source(folder, plain, options.source)
    root = place_of(expanded(found.source))
    camera = _file("camera", options.camera, passport.options.camera, root)
    sensors = passport.options.sensors
    if sensors in (str(AUTO), str(NONE)):
        found_sensors = _file("sensors", options.sensors, None, root) or Path(sensors)
    else:
        found_sensors = _file("sensors", options.sensors, sensors, root) or NONE
    return replace(found, options=replace(found.options, camera=camera, sensors=found_sensors))


def _file(option: str, given: Path | None, recorded: str | None, root: Path) -> Path | None:
    """Where a file that the run had as an option is: where a person says so, or else in the folder of the source."""
    if recorded is None:
        if given is not None:
            raise InputError(f"--{option} is {given}, but the run had no such file: leave it out")
        return None
    path = root / recorded if given is None else expanded(given)
    if given is None and not (is_below(path, (root,)) and exists(path)):
        raise InputError(f"the run had --{option} {recorded[:200]}, which is not in {root}: give --{option}, too")
    return path


def _answers(folder: Path, passport: Passport, again: Run | None, reasons: Mapping[str, str]) -> list[Answer]:
    found = {each.method: each for each in outputs(again)} if again is not None else {}
    answers = list[Answer]()
    for each in passport.outputs:
        if again is None or each.method in reasons:
            answers.append(Answer(each.method, CANNOT_TELL, f"cannot tell: {reasons[each.method]}"))
            continue
        now = found[each.method]
        if (now.poses_sha256, now.steps_sha256) == (each.poses_sha256, each.steps_sha256):
            answers.append(Answer(each.method, 0))
        elif now.poses_sha256 == each.poses_sha256:
            line = "the final poses are the same bytes, but what was computed at the frames is not"
            answers.append(Answer(each.method, DIFFERENT, line))
        else:
            with confined((folder,)):
                line = _distance(folder / trajectory_file(each.method), each, again)
            answers.append(Answer(each.method, DIFFERENT, line))
    return answers


def _distance(path: Path, recorded: Output, again: Run) -> str:
    """How far the poses in a passport are from those of a run."""
    if not exists(path):
        return f"how far the poses are from each other, nobody can tell: {path.name} is missing"
    now = again.trajectories[recorded.method]
    found = spread(read_tum(path, now.frame), now)
    if not found.common:
        return f"no two poses are at the same time ({found.others} poses)"
    unit = "m" if recorded.unit == "metric" else "of its own unit"
    line = (
        f"position differs by at most {found.position[0]:.3g} {unit} (median {found.position[1]:.3g}), rotation by at "
        f"most {found.rotation_deg[0]:.3g} deg (median {found.rotation_deg[1]:.3g}), over {found.common} poses"
    )
    line += f"; {found.others} poses are in one run only" if found.others else ""
    known = [(recorded.sigma_position, unit), (recorded.sigma_deg, "deg")]
    sigmas = ", ".join(f"{sigma:.3g} {unit}" for sigma, unit in known if sigma is not None)
    line += f"; standard deviation that the run states (median): {sigmas}" if sigmas else ""
    changed = sha256_of(path) != recorded.poses_sha256
    return line + (f"; {path.name} is not the file whose digest {PASSPORT} has" if changed else "")


def _machines(run: RunFile, again: RunFile) -> Iterator[str]:
    """What the passport's run and the repeated one were made with, where that differs."""
    if run.images_sha256 != again.images_sha256:
        yield "the images have other pixels here: another decoder or renderer"
    a, b = machine_of(run), machine_of(again)
    for name in dict.fromkeys((*a, *b)):
        if a.get(name) != b.get(name):
            yield f"{name}: {shown(a.get(name))} | {shown(b.get(name))}"


def _print(answers: list[Answer], notes: list[str]) -> None:
    by_code = {code: [each.method for each in answers if each.code == code] for code in (DIFFERENT, CANNOT_TELL, 0)}
    words = {DIFFERENT: "not the same bytes", CANNOT_TELL: "cannot tell", 0: "same bytes"}
    lines = [f"{words[code]}: {', '.join(methods)}" for code, methods in by_code.items() if methods]
    lines += [f"{each.method}: {each.line}" for each in answers if each.line]
    sys.stdout.write("".join(f"{printable(line)}\n" for line in (*lines, *notes)))
