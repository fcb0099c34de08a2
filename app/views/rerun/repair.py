"""Repairs recordings whose writer was killed, or whose disk was full: it adds their index, and gives them their
name."""

from __future__ import annotations

import os
import warnings
from contextlib import suppress
from pathlib import Path

import rerun as rr
from rerun.chunk import RrdReader

from ispom.errors import InputError
from ispom.io.whole import part_of, whole_of
from ispom.sequences.decoder_output import silenced

from ...engine.run_folder.run_folder import locked
from .piped_file import PipedFile
from .rrd import count_messages, is_empty, is_finished, whole_bytes

PATIENCE_S = 3600.0
"""Longest wait for the copy of a recording."""


def unfinished(folder: Path) -> list[Path]:
    """Returns the recordings in a folder that were not closed, including those that are being written. OSError where
    the folder cannot be read."""
    files = sorted(path for path in folder.iterdir() if path.suffix == ".rrd" and path.is_file())
    return [path for path in files if path != whole_of(path) or not is_finished(path)]


def finish(path: Path) -> Path | None:
    """Gives a recording its index, and a hidden one its name. Returns its path, or None where it was empty and is
    removed.

    InputError where it is still being written, or the disk is full; the file is unchanged then.
    """
    if path.is_symlink():
        raise InputError(f"{path} is a link: repair the file that it leads to, or remove it")
    final = whole_of(path)
    try:
        with locked(final):
            return _finish(path, final)
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"{path} cannot be repaired ({error}): make room, or see to its folder") from None


def _finish(path: Path, final: Path) -> Path | None:
    if path != final and is_empty(path):
        path.unlink()
        return None
    if final != path and final.exists():
        raise InputError(f"{final} exists already: move it away, and repair again")
    if not is_finished(path):
        whole = whole_bytes(path)
        if whole == 0:
            raise InputError(f"{path} is no recording of this version of Rerun: it stays as it is")
        os.truncate(path, whole)
        copy = part_of(final.with_name(f"repaired-{final.name}"))
        try:
            _copy(path, copy)
            os.replace(copy, path)
        finally:
            with suppress(OSError):
                copy.unlink(missing_ok=True)
    os.replace(path, final)
    return final


def _copy(source: Path, copy: Path) -> None:
    """Copies every message of one file into another, and closes that properly."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rr.error_utils.RerunWarning)  # the missing index is what is repaired here
        entry = next(iter(RrdReader(source).recordings()), None)
    if entry is None:
        raise InputError(f"{source} holds no exposure: delete it")
    file = PipedFile(copy)
    stream = rr.RecordingStream(entry.application_id, recording_id=entry.recording_id, send_properties=False)
    try:
        stream.save(file.target)
    finally:
        file.opened()
    with silenced():  # Rerun prints decoding errors on standard error; they are reported below
        stream.log_file_from_path(source)
        stream.flush(timeout_sec=PATIENCE_S)
        stream.disconnect()
    if not file.ended(PATIENCE_S) or file.failure is not None:
        raise file.failure or TimeoutError("the disk does not answer")
    if count_messages(copy) != count_messages(source):
        raise InputError(f"{source} cannot be read to its end: it stays as it is")
