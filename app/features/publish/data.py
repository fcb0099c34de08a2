"""The files of runs that are published together: the first one whole, and what its comparisons with others found."""

from __future__ import annotations

import copy
from base64 import b64encode
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from ispom.errors import InputError

from ...engine.run_folder.run_folder import RECORDING
from ...session.current_run import CurrentRun
from ...session.session import Session
from ...session.state import State
from ...views.rerun.batch import Entry
from ...views.rerun.live import layout_of
from ..branches.stage import trajectories, visible_branches
from .messages import numbers_message, run_message
from .panels import CHUNK, fixed_panels, frame_panels
from .private import Plain
from .review import Review
from .site import packed
from .stage import Stage, StageWriter


def data_files(review: Review, folders: list[Path], most_bytes: float) -> tuple[dict[str, bytes], Stage]:
    """Returns the files of the runs by name, with at most `most_bytes` together, and the stage, which is one of
    them."""
    session = review.session
    run, state = session.run, review.state
    if run is None or not len(run.history):
        raise InputError(f"{folders[0]} holds no frame: run again")
    plain = Plain([Path.home(), *folders, *(folder.parent for folder in folders)])
    message = plain.message(run_message(state, run))
    message["panels"] = plain.message(fixed_panels(state, run))
    message["runs"] = list(review.names if review.comparisons else review.names[:1])
    found = {name: packed(content) for name, content in _panels(state, run, plain)}
    found |= _comparisons(review, plain, has_pictures=True)
    found["numbers.bin"] = packed(plain.message(numbers_message(run)))
    writer = StageWriter(folders[0] / RECORDING, _others(session, state), partial(layout_of, run.opened))
    rest = sum(map(len, found.values()))
    stage = writer.fitting(most_bytes - rest, lambda stage: len(packed(_said_of(stage, message))))
    found |= _comparisons(review, plain, has_pictures=bool(stage.images.every))
    return found | {"run.bin": packed(_said_of(stage, message)), "stage.bin": stage.content}, stage


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
            yield f"panels-{number}.bin", chunk
            chunk, number = [], number + 1
    if chunk:
        yield f"panels-{number}.bin", chunk


def _comparisons(review: Review, plain: Plain, *, has_pictures: bool) -> dict[str, bytes]:
    """With the images at the frame where paths part, where the stage has images."""
    if not review.comparisons:
        return {}
    messages = zip(review.comparisons, review.pictures, strict=True)
    shown = [
        plain.message(message) | {"pictures": None if pair is None or not has_pictures else [*map(_address, pair)]}
        for message, pair in messages
    ]
    return {"comparisons.bin": packed(shown)}


def _address(jpeg: bytes) -> str:
    """As the source of an image."""
    return f"data:image/jpeg;base64,{b64encode(jpeg).decode()}"


def _others(session: Session, state: State) -> Iterator[Entry]:
    """The trajectories of the other runs, whole."""
    return trajectories(visible_branches(session, state), frozenset())
