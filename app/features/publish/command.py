"""`ispom publish`: reads finished runs, writes the folder, and says what takes how much of it."""

from __future__ import annotations

import copy
import math
import shlex
import sys
from base64 import b64encode
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from ispom.errors import InputError, printable
from ispom.io.files import expanded

from ...engine.outputs import claim_folder
from ...engine.run_folder.run_folder import RECORDING
from ...session.current_run import CurrentRun
from ...session.session import Session
from ...session.state import State
from ...views.rerun.batch import Entry
from ...views.rerun.live import layout_of
from ...views.web.rerun_assets import viewer_files
from ..branches.stage import trajectories, visible_branches
from .messages import finished_state, numbers_message, run_message
from .options import Publish
from .panels import CHUNK, fixed_panels, frame_panels
from .private import Plain
from .review import Review, plain_name, require_run, reviewed
from .site import packed, packed_viewer, page_files, write_site
from .stage import Stage, StageWriter

COMMAND = "publish"
MB = 1e6


def publish(options: Publish) -> int:
    """Writes the folder; InputError where a folder holds no complete run with a recording, where runs are of different
    sources, or where the folder cannot be as small as asked."""
    if not options.runs:
        raise InputError("no run was given: name one or more folders that `ispom run` wrote")
    if not 0 < options.max_mb < math.inf:
        raise InputError(f"--max-mb is {options.max_mb}: give a positive number of megabytes")
    folders = [expanded(folder) for folder in options.runs]
    for folder in folders:
        require_run(folder)
    out = expanded(options.out)
    claim_folder(out, COMMAND)
    with reviewed(folders, _names(folders)) as review:
        files = _page(len(folders))
        data, stage = _data(review, folders, options.max_mb * MB - sum(map(len, files.values())))
    write_site(out, files | data)
    _report(out, files | data, stage)
    return 0


def _page(runs: int) -> dict[str, bytes]:
    try:
        return page_files(runs) | packed_viewer(viewer_files())
    except OSError as error:
        raise InputError(str(error)) from None


def _data(review: Review, folders: list[Path], most_bytes: float) -> tuple[dict[str, bytes], Stage]:
    """The files of the runs, which take at most so many bytes; and the stage, which is one of them."""
    session = review.session
    run, state = session.run, finished_state(session.state, review.names[0])
    if run is None or not len(run.history):
        raise InputError(f"{folders[0]} holds no frame: run again")
    plain = Plain([Path.home(), *folders, *(folder.parent for folder in folders)])
    message = plain.message(run_message(state, run))
    message["panels"] = plain.message(fixed_panels(state, run))
    message["runs"] = list(review.names)
    found = {name: packed(content) for name, content in _panels(state, run, plain)}
    found |= _comparisons(review, plain, has_pictures=True)
    found["data/numbers.bin"] = packed(plain.message(numbers_message(run)))
    writer = StageWriter(folders[0] / RECORDING, _others(session, state), partial(layout_of, run.opened))
    rest = sum(map(len, found.values()))
    stage = writer.fitting(most_bytes - rest, lambda stage: len(packed(_said_of(stage, message))))
    found |= _comparisons(review, plain, has_pictures=bool(stage.images.every))
    return found | {"data/run.bin": packed(_said_of(stage, message)), "data/stage.bin": stage.content}, stage


def _said_of(stage: Stage, message: dict[str, Any]) -> dict[str, Any]:
    """The message of the run with what the page must know of the stage."""
    said = copy.deepcopy(message)
    said["stage"] = {"recording": stage.recording, "frames": stage.frames}
    said["message"]["recording_id"] = stage.recording
    said["panels"]["first"]["explain"]["notes"].append(f"Images: {stage.images}.")
    return said


def _panels(state: State, run: CurrentRun, plain: Plain) -> Iterator[tuple[str, list[Any]]]:
    chunk: list[Any] = []
    number = 0
    for values in frame_panels(state, run):
        chunk.append(plain.message(values))
        if len(chunk) == CHUNK:
            yield f"data/panels-{number}.bin", chunk
            chunk, number = [], number + 1
    if chunk:
        yield f"data/panels-{number}.bin", chunk


def _comparisons(review: Review, plain: Plain, *, has_pictures: bool) -> dict[str, bytes]:
    """With the images at the frame where paths part, where the stage has images."""
    if not review.comparisons:
        return {}
    messages = zip(review.comparisons, review.pictures, strict=True)
    shown = [
        plain.message(message) | {"pictures": None if pair is None or not has_pictures else [*map(_address, pair)]}
        for message, pair in messages
    ]
    return {"data/comparisons.bin": packed(shown)}


def _address(jpeg: bytes) -> str:
    """As the source of an image."""
    return f"data:image/jpeg;base64,{b64encode(jpeg).decode()}"


def _others(session: Session, state: State) -> Iterator[Entry]:
    """The trajectories of the other runs, whole."""
    return trajectories(visible_branches(session, state), frozenset())


def _names(folders: list[Path]) -> list[str]:
    """The names of the folders, with a number where two have the same."""
    names = [plain_name(folder) for folder in folders]
    return [name if names.count(name) == 1 else f"{name} ({i + 1})" for i, name in enumerate(names)]


def _report(out: Path, files: Mapping[str, bytes], stage: Stage) -> None:
    def size(*beginnings: str) -> int:
        return sum(len(content) for name, content in files.items() if name.startswith(beginnings))

    total = sum(map(len, files.values()))
    other = size("data/stage") - stage.image_bytes
    parts = {
        "Rerun viewer": size("rerun/"),
        f"images ({stage.images})": size("data/stage") - other,
        "tracks, paths, points": other,
        "verdicts and checks": size("data/panels"),
        "page, plots, events": total - size("rerun/", "data/stage", "data/panels"),
    }
    lines = [f"  {count / MB:6.2f} MB  {name}" for name, count in parts.items()]
    sys.stdout.write(printable(f"{out} ({total / MB:.1f} MB, {len(files)} files)") + "\n" + "\n".join(lines) + "\n")
    sys.stdout.write(
        f"Look at it: python -m http.server --bind 127.0.0.1 --directory {printable(shlex.quote(str(out)))}\n"
    )
