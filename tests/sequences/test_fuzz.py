"""Whatever happens to a text file of a recording: it opens, or one sentence says what is wrong."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ispom.errors import InputError
from ispom.sequences import open_sequence
from tests.sequences.folders import MAKERS

TEXTS = {".txt", ".csv", ".yaml"}
PIECES = [
    "",
    "nan",
    "-1",
    "0",
    "1e400",
    "9" * 30,
    "a: [",
    "- x",
    ":",
    ",",
    "#",
    "\n",
    "\r",
    "\0",
    "\x85",
    "\t",
    "é",
    "²",
    "[",
    "{",
]


@pytest.fixture(scope="module", params=["kitti", "kitti raw, extract", "euroc", "tum", "7-scenes"])
def made(request: pytest.FixtureRequest):
    with TemporaryDirectory() as root:
        yield MAKERS[request.param](Path(root) / "made")


@given(data=st.data())
def test_a_spoilt_text_file_is_no_traceback(made: Path, data: st.DataObject) -> None:
    root = next(parent for parent in made.parents if parent.name == "made") if made.name != "made" else made
    path = data.draw(st.sampled_from(sorted(p for p in root.rglob("*") if p.suffix in TEXTS)))
    whole = path.read_bytes()
    start = data.draw(st.integers(0, len(whole)))
    end = data.draw(st.integers(start, min(len(whole), start + 40)) | st.just(len(whole)))
    piece = data.draw(st.sampled_from(PIECES).map(str.encode) | st.binary(max_size=6))
    try:
        path.write_bytes(whole[:start] + piece + whole[end:])
        open_sequence(str(made))
    except InputError as mistake:
        assert "\n" not in str(mistake)
    finally:
        path.write_bytes(whole)
