"""expected.json: what happens in a clip that was shrunk, and of what it is the smallest."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec

from ispom.errors import InputError
from ispom.io.files import MAX_BYTES
from ispom.io.rows import read_text
from ispom.methods import Config, method
from ispom.settings import from_plain

from ...engine.outputs import json_of
from .trial import Failure

EXPECTED = "expected.json"


class Event(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The event that the clip shows."""

    kind: str
    """Name of the kind, as in events.csv."""
    method: str
    """The method whose event it is; empty for an image that could not be read."""
    cause: str
    """Key of the check that made it; empty where none did."""
    severity: str
    sentence: str
    frame: int
    """Number of the measurement in the clip, as in events.csv of a run over it."""
    time_ns: int
    """On the clock of the recording, which the clip keeps."""
    recorded_frame: int
    """Number of that frame in the recording, by the times at which any camera has one."""
    whole_frame: int
    """Number of the frame at which the event begins in the whole recording."""
    from_ns: int
    until_ns: int
    """The event is the expected one where it begins at a frame from the one time to the other, both included."""


class Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is left of the recording."""

    frames: tuple[int, ...]
    """Numbers of its frames in the recording, by the times at which any camera has one."""
    of_frames: int
    """Number of frames in the recording."""
    halvings: int
    """How many times width and height of the images were halved."""
    cameras: tuple[str, ...]
    """Kinds of frames: stereo, video."""


class Expected(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The content of expected.json."""

    event: Event
    part: Part
    methods: tuple[str, ...]
    config: dict[str, Any]
    """By method: every setting."""
    external: tuple[str, ...]
    """NAME[:KINDS]=COMMAND of methods that are programs. They are started only where the command line names them."""
    recording: str
    """Name of the recording; empty with --private."""
    private: bool
    """Whether the images are drawn tracks."""
    trials: int
    """Number of clips that were run."""
    complete: bool
    """Whether the event is gone without any single frame, method or camera, and with smaller images; else the trials
    were used up."""
    images_sha256: str
    """Of the time, size and pixels of all images, as in run.yaml."""
    versions: dict[str, str]
    """Of the packages with which the event happened."""

    @property
    def failure(self) -> Failure:
        """The event as another run may have it."""
        event = self.event
        return Failure(event.kind, event.method, event.cause, event.from_ns, event.until_ns)

    def configs(self) -> Config:
        """Returns the settings. Raises InputError for what is none, and for methods that are not there."""
        return Config(
            {name: from_plain(method(name).config, values, f"config.{name}") for name, values in self.config.items()}
        )

    @property
    def text(self) -> str:
        """The file's content."""
        return json_of(self)


def read_expected(folder: Path) -> Expected:
    """Reads the file of a folder. Raises InputError where there is none, or it is not as written."""
    path = folder / EXPECTED
    try:
        return msgspec.convert(json.loads(read_text(path, MAX_BYTES)), Expected)
    except (ValueError, RecursionError, msgspec.ValidationError) as fault:
        raise InputError(f"{path} is not as `ispom shrink` writes it ({fault}): restore the file") from None
