"""The command: describes a run that is there, and writes the folder."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec

from ispom.ensemble import build
from ispom.errors import InputError, counted, printable
from ispom.io.files import expanded, is_below, read_bytes
from ispom.io.whole import write_whole
from ispom.methods import names, with_dependencies
from ispom.sequences.recorded_sensors import AUTO, NONE

from ...engine.outputs import MARKER, claim_folder, json_of
from ...engine.playback import Builder
from ...engine.run_folder.run_file import RunFile, read_run_file
from ...engine.run_folder.run_folder import RUN, ended_early, trajectory_file
from ...engine.signals import terminable
from ...session.review.stored import StoredSource, stored_source
from ..report.blocks import Table
from ..report.folder import Run, read_run
from ..report.results import results
from .inputs import Roots, files_read, key_of, roots_of
from .options import Passport
from .outputs import outputs
from .readme import CITATION, README, citation, readme
from .verify import verify
from .written import (
    COMMAND,
    PASSPORT,
    VERSION,
    Machine,
    RunOptions,
    Source,
    Stage,
    mark_of,
    require_no_files,
)
from .written import Passport as PassportFile

NOT_COMPUTED = ("recording", "variant")
"""Options in run.yaml that say what is written, or which methods are chosen."""


def passport(options: Passport, builder: Builder = build) -> int:
    """Writes a passport, or verifies one, and returns the exit code. Raises InputError for a mistake of the user."""
    if options.verify:
        return verify(options, builder)
    for name in ("camera", "sensors"):
        if getattr(options, name) is not None:
            raise InputError(f"--{name} belongs to --verify: leave it out, for the run says what it had")
    folder, to = expanded(options.run), expanded(options.to)
    if to.is_symlink():
        raise InputError(f"{to} is a link: give a new or empty folder")
    with terminable():
        found, run = described(folder, options.source)
        _write(to, found, run)
    files = counted(len(found.source.files), "file")
    sys.stdout.write(printable(f"in {to}: {files} of the source, poses of {', '.join(run.metrics)}") + "\n")
    sys.stdout.write(
        printable(f"`ispom passport --verify {shlex.quote(str(to))}` repeats the run and compares it") + "\n"
    )
    return 0


def described(folder: Path, moved_to: str | None) -> tuple[PassportFile, Run]:
    """Returns the passport of a run, and the run as a report has it. Raises InputError where the run did not come to
    its end, names files in its settings, or has not its images any more."""
    if folder.suffix == ".rrd":
        raise InputError(
            f"{folder} is a recording, which has no settings, and what was done by hand in the page is not in it: run "
            "the same by `ispom run` or `ispom fork`, and give the folder that it writes"
        )
    file, run = read_run_file(folder), read_run(folder, folder.name)
    if file.images_sha256 is None or ended_early(folder):
        raise InputError(f"{folder} holds a run that did not come to its end, which cannot be repeated: run it again")
    require_no_files(folder, file)
    missing = [name for name in with_dependencies(run.metrics) if name not in file.config]
    if missing or not run.metrics:
        what = f"no settings of {missing[0]}" if missing else "no method"
        raise InputError(f"{folder / RUN} has {what}: restore the file, or run again")
    source = stored_source(folder, file, moved_to)
    how = source.options
    roots = roots_of(source.source, how.camera, how.sensors)
    files = files_read(source, file.images_sha256, roots)
    try:
        found = PassportFile(
            VERSION,
            Source(
                file.source, file.sequence, tuple(map(str, file.notes)), dict(file.exposures), file.images_sha256, files
            ),
            _options(file, source, roots, tuple(run.metrics)),
            dict(file.config),
            tuple(Stage(s.until, s.methods, _settings(s.config.given)) for s in file.earlier),
            Machine(dict(file.versions), file.platform, file.processor),
            run.path_length_m,
            outputs(run),
        )
        return msgspec.convert(msgspec.to_builtins(found), PassportFile), run  # a stranger's run.yaml may hold anything
    except (msgspec.ValidationError, TypeError, OverflowError) as fault:
        raise InputError(f"{folder / RUN} is not as `ispom run` writes it ({fault}): run again") from None


def _settings(given: Mapping[str, Any]) -> dict[str, Any]:
    return {name: asdict(values) for name, values in given.items()}


def _options(file: RunFile, source: StoredSource, roots: Roots, methods: tuple[str, ...]) -> RunOptions:
    """Those of the run, with files named as in the list of inputs."""
    how = source.options
    values = {name: value for name, value in file.options.items() if name not in NOT_COMPUTED}
    values |= {"methods": methods, "camera": _name(how.camera, roots)}
    values["sensors"] = str(how.sensors) if how.sensors in (AUTO, NONE) else _name(how.sensors, roots)
    return msgspec.convert(values, RunOptions)


def _name(file: Path | None, roots: Roots) -> str | None:
    if file is None:
        return None
    path = expanded(file)
    return key_of(path, roots)[1] if "source" in roots and is_below(path, (roots["source"],)) else path.name


def _write(to: Path, found: PassportFile, run: Run) -> None:
    """The file by which a folder is a passport comes last: a folder that was half written is none."""
    claim_folder(to, COMMAND)
    (to / PASSPORT).unlink(missing_ok=True)
    for name in names():
        if name in run.metrics:
            write_whole(to / trajectory_file(name), read_bytes(run.path / trajectory_file(name)))
        else:
            (to / trajectory_file(name)).unlink(missing_ok=True)  # of an earlier passport
    table = results([run])[0]
    assert isinstance(table, Table)
    write_whole(to / README, readme(found, table))
    write_whole(to / CITATION, citation(found))
    content = json_of(found).encode()
    write_whole(to / MARKER, mark_of(content))
    write_whole(to / PASSPORT, content)
