"""README.md and CITATION.cff of a passport."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import msgspec
import yaml

from ispom.errors import counted, printable

from ...presentation.texts import size
from ..headless.options import Run as RunCommand
from ..headless.words import flags, run_words
from ..report.blocks import MethodName, Table
from .written import PASSPORT, Passport

README, CITATION = "README.md", "CITATION.cff"
AUTHORS = {"name": "The authors of ISPOM"}
PAPER = {
    "type": "article",
    "title": "Image-based self-position and orientation method for moving platform",
    "authors": [{"family-names": "Li"}, {"family-names": "Liu"}, {"family-names": "Yuan"}],
    "journal": "Science China Information Sciences",
    "volume": 56,
    "start": "042301",
    "year": 2013,
    "doi": "10.1007/s11432-012-4649-9",
}
"""As in the CITATION.cff of the project, which an installation does not have."""
SOFTWARE = {
    "type": "software",
    "title": "ISPOM: visual odometry to run, stop, rewind, question and compare in a browser",
    "authors": [dict(AUTHORS)],
    "license": "MIT",
}


def citation(passport: Passport) -> str:
    """Returns the content of CITATION.cff: this run, the software with its version, and the paper."""
    version = passport.machine.versions.get("ispom", "")
    values = {
        "cff-version": "1.2.0",
        "message": "Please cite this run, the software that made it, the paper whose method it implements, and the "
        "data set of the recording.",
        "type": "dataset",
        "title": f"{_methods(passport)} over {printable(passport.source.sequence)}: a run of ISPOM {version}",
        "authors": [AUTHORS],
        "references": [{**SOFTWARE, "version": version}, PAPER],
    }
    return yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=120)


def readme(passport: Passport, results: Table) -> str:
    """Returns the content of README.md; `results` are the figures of the run."""
    return "\n".join(
        (*_what(passport), *_how(passport), *_results(passport, results), *_made_with(passport), *_files(passport))
    )


def _what(passport: Passport) -> Iterator[str]:
    source = passport.source
    frames = ", ".join(f"{count} {kind}" for kind, count in source.frames.items() if count)
    yield from (f"# {_methods(passport)} over {printable(source.sequence)}", "")
    yield (
        "This folder describes a run of visual odometry. With it you can repeat the run, check that you get the same "
        f"poses, and cite it. The run saw {frames} measurements of `{printable(source.address)}`."
    )
    if source.notes:
        yield from ("", *(f"- {printable(note)}" for note in source.notes))


def _how(passport: Passport) -> Iterator[str]:
    source, version = passport.source, passport.machine.versions.get("ispom", "")
    simulated = source.address.startswith("sim:")
    yield from ("", "## Repeat it", "", f"1. Install ISPOM {version}, with the versions below where you can.")
    if simulated:
        yield "2. There is nothing to copy: the images of a simulation are made from its address."
    else:
        total = size(sum(each.bytes for each in source.files))
        yield (
            f"2. Get the recording. It has {counted(len(source.files), 'file')} ({total}), and `{PASSPORT}` has the "
            "name, size and SHA-256 of each."
        )
    words = ["ispom", "passport", "--verify", "."] + ([] if simulated else ["--source", "RECORDING"])
    yield from ("3. In this folder:", "", "```sh", shlex.join(words), "```", "")
    yield (
        "It compares the files, runs the methods with the same settings, and says first whether the bytes are the "
        "same. If not, it says how far the poses are from these. A usual cause is rounding, on another processor or "
        "with other versions."
    )
    if passport.forked:
        yield from ("", "The run is a fork: its settings changed on the way, and only this command repeats it.")
    else:
        yield from ("", "The run alone:", "", "```sh", printable(shlex.join(_command(passport, simulated))), "```")


def _command(passport: Passport, simulated: bool) -> list[str]:
    options = msgspec.to_builtins(passport.options)
    del options["methods"]
    source = passport.source.address if simulated else "RECORDING"
    config: Any = passport.config
    words = run_words(source, passport.options.methods, config)
    return [*words, *flags(options, {**vars(RunCommand(source=source)), "sensors": "auto", "topics": ()})]


def _results(passport: Passport, results: Table) -> Iterator[str]:
    lengths = (f"{each.length:.4g} {'m' if each.unit == 'metric' else '(own unit)'}" for each in passport.outputs)
    rows = (*results.rows, ["length of the path", *lengths])
    yield from ("", "## Results", "", *_table(results.head, rows))


def _made_with(passport: Passport) -> Iterator[str]:
    machine = passport.machine
    rows = [*machine.versions.items(), ("platform", machine.platform), ("processor", machine.processor)]
    yield from ("", "## Made with", "", *_table(("", "version"), rows))


def _files(passport: Passport) -> Iterator[str]:
    yield from ("", "## Files", "")
    yield f"- `{PASSPORT}`: all of this for programs, with every setting (`ispom schema passport` describes it)."
    yield "- `METHOD.tum`: the final poses of a method: time, position, quaternion x, y, z, w."
    yield f"- `{CITATION}`: how to cite the run. Cite the data set of the recording, too."
    yield ""
    yield from ("| method | SHA-256 of its poses |", "| --- | --- |")
    yield from (f"| {each.method} | `{each.poses_sha256}` |" for each in passport.outputs)
    yield ""


def _methods(passport: Passport) -> str:
    return ", ".join(each.method for each in passport.outputs)


def _table(head: Sequence[Any], rows: Iterable[Sequence[Any]]) -> Iterator[str]:
    yield f"| {' | '.join(map(_cell, head))} |"
    yield "|" + " --- |" * len(head)
    yield from (f"| {' | '.join(map(_cell, row))} |" for row in rows)


def _cell(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, MethodName):
        return value.name
    return f"{value:.4g}" if isinstance(value, float) else printable(str(value)).replace("|", "\\|")
