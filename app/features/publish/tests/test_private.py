"""Paths become the names at their end; nothing else changes."""

from __future__ import annotations

from pathlib import Path

import pytest

from ..private import Plain


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        ("/home/ann/drives/06 is not there", "06 is not there"),
        ("cannot read '/data/left/000020.png': truncated", "cannot read '000020.png': truncated"),
        (r"C:\Users\ann\drives\06.bag", "06.bag"),
        ("~/drives/06", "06"),
        ("<b>/home/ann/x.png</b>", "<b>x.png</b>"),
        ("a run of 10 m/s, 1/2 of it", "a run of 10 m/s, 1/2 of it"),
        ("left/000020.png", "left/000020.png"),
        ("</span></div><br/>", "</span></div><br/>"),
        ("http://localhost:80/a/b", "http://localhost:80/a/b"),
    ],
)
def test_texts(text: str, plain: str) -> None:
    assert Plain().text(text) == plain


def test_a_known_place_is_cut_off_with_its_spaces(tmp_path: Path) -> None:
    place = tmp_path / "two words"
    place.mkdir()
    assert Plain([place]).text(f"stored in {place}/run: {place}") == "stored in run: two words"


def test_paths_of_entities_stay() -> None:
    message = {"hidden": ["/view/a/b/visualizers"], "notes": ["/home/ann/06"], "deep": [{"text": "/home/ann/06"}]}
    assert Plain().message(message) == {
        "hidden": ["/view/a/b/visualizers"],
        "notes": ["06"],
        "deep": [{"text": "06"}],
    }
