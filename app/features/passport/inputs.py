"""The files that a source reads: listed with their hashes, and compared with a list.

The name of a file in a passport opens nothing outside of the folder that a person named as the source. Files beside
that folder, such as KITTI's poses, are those that the source itself reads there.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from ispom.errors import InputError, counted
from ispom.io.files import exists, expanded, is_below, noted, require_file, sha256_of
from ispom.sequences.recorded_sensors import AUTO, NONE
from ispom.stop import check_stop
from ispom.types import FRAME_KINDS, Sequence

from ...session.review.stored import StoredSource, compared, place_of
from .written import InputFile, Place, Source

NAMED = 4
"""Files that a sentence names; the others are counted."""
Roots = Mapping[Place, Path]
"""By place: the folder at which names begin."""
Key = tuple[Place, str]


def roots_of(source: str, camera: Path | None, sensors: Path) -> Roots:
    """Returns the folders of a source and of the files that belong to it; none of a simulation's."""
    if source.startswith("sim:"):
        return {}
    found: dict[Place, Path] = {"source": place_of(expanded(source))}
    if camera is not None:
        found["camera"] = expanded(camera).parent
    if sensors not in (AUTO, NONE):
        found["sensors"] = expanded(sensors).parent
    return found


def key_of(path: Path, roots: Roots) -> Key:
    """Returns place and name of a file: below the first folder that holds it; else seen from the source."""
    here = os.path.abspath(path)
    for place, root in roots.items():
        if Path(here).is_relative_to(os.path.abspath(root)):
            return place, Path(os.path.relpath(here, root)).as_posix()
    return "source", Path(os.path.relpath(here, roots["source"])).as_posix() if roots else path.name


def files_read(found: StoredSource, images_sha256: str, roots: Roots) -> tuple[InputFile, ...]:
    """Returns all files that a source reads. Raises InputError where its images are not those of the digest; those of
    a simulation are not made for that."""
    with noted() as paths:
        sequence = found.opened()
        if not found.source.startswith("sim:"):
            compared(sequence, images_sha256, found.source).load(0)
    files = {key_of(path, roots): path for path in paths}
    return tuple(_listed(*key, path) for key, path in sorted(files.items()))


def _listed(place: Place, name: str, path: Path) -> InputFile:
    check_stop()
    return InputFile(place, name, require_file(path), sha256_of(path))


def open_same(found: StoredSource, recorded: Source, roots: Roots, whole: bool) -> Sequence:
    """Returns the sequence of a source whose files are those of a passport. Raises InputError that names the files
    which differ, are missing, or are read and not in the passport, and where a run over the `whole` source had another
    number of frames."""
    source = found.source
    expected: dict[Key, InputFile] = {(each.place, each.name): each for each in recorded.files}
    near: dict[Key, Path] = {key: path for key in expected if (path := _below(key, roots)) is not None}
    _require(source, _differences({key: expected[key] for key in near}, near))
    with noted() as paths:
        sequence = found.options.open(source)
        missing = expected.keys() - near.keys() - {key_of(path, roots) for path in paths}
        if missing and not source.startswith("sim:"):  # images beside the source are read one by one
            compared(sequence, recorded.images_sha256, source).load(0)
    read = {key_of(path, roots): path for path in paths}
    others = {key: each for key, each in expected.items() if key not in near}
    more = (f"{name} is read, too" for _, name in sorted(read.keys() - expected.keys()))
    _require(source, [*_differences(others, read), *more])
    for kind in FRAME_KINDS if whole else ():
        here, there = sequence.kinds.count(kind), recorded.frames.get(kind, 0)
        if here != there:
            raise InputError(f"{source} has {here} {kind} frames, but the run had {there}: give the run's own")
    return sequence


def _below(key: Key, roots: Roots) -> Path | None:
    """The path of a file of the list that lies, links followed, below the folder at which its name begins."""
    root = roots.get(key[0])
    path = None if root is None else root / key[1]
    return path if path is not None and is_below(path, (root,)) else None  # type: ignore[arg-type]


def _differences(expected: Mapping[Key, InputFile], paths: Mapping[Key, Path]) -> Iterator[str]:
    for key, each in expected.items():
        check_stop()
        path = paths.get(key)
        if path is None or not exists(path):
            yield f"{each.name} is missing"
        elif require_file(path) != each.bytes or sha256_of(path) != each.sha256:
            yield f"{each.name} differs"


def _require(source: str, wrong: Iterable[str]) -> None:
    if faults := list(wrong):
        more = f", and {counted(len(faults) - NAMED, 'more file')}" if len(faults) > NAMED else ""
        raise InputError(
            f"the files of {source} are not those of the run: {', '.join(faults[:NAMED])}{more}; give the run's own"
        )
