"""YAML files: short texts that stand for much, or for nothing of the kind, are refused before they cost anything."""

from __future__ import annotations

from pathlib import Path

import pytest

from ispom.errors import InputError
from ispom.io.mapping import MAX_BYTES, read_mapping


def laughs(merged: bool) -> str:
    """Ten lines of aliases that stand for ten thousand million values."""
    first = "l0: &l0 {x: 1}\n" if merged else "l0: &l0 [x]\n"
    lines = [f"&l{i} {{<<: [{', '.join([f'*l{i - 1}'] * 10)}]}}" for i in range(1, 11)]
    if not merged:
        lines = [f"&l{i} [{', '.join([f'*l{i - 1}'] * 10)}]" for i in range(1, 11)]
    return first + "".join(f"l{i}: {line}\n" for i, line in enumerate(lines, 1))


@pytest.mark.parametrize(
    "text",
    [laughs(False), laughs(True), "a: &a [*a]", "a: " + "[" * 200 + "]" * 200, "x: y\n" * 12_000],
    ids=["aliases", "merged aliases", "holds itself", "deep", "many"],
)
def test_more_than_any_settings_hold_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(InputError, match=r"holds more than 20000 values .aliases written out. or nests too deep"):
        read_mapping(tmp_path / "a.yaml")


@pytest.mark.parametrize(
    "text",
    [
        "a: !!int ''",
        "a: !!bool x",
        "a: !!timestamp x",
        "a: !!python/name:os.system x",
        "a: 2001-13-45",
        "a: " + "[" * 5000,
        "? [a]\n: b",
        "0x" + "f" * 9000,
        "0x" + "f" * 9000 + ": 1",
    ],
)
def test_what_yaml_s_own_constructors_fail_on_is_one_sentence(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(InputError, match=r"is not valid YAML: correct it|holds no named values"):
        read_mapping(tmp_path / "a.yaml")


def test_aliases_as_people_use_them_are_read(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("left: &cam {fx: 1, fy: 2}\nright: {<<: *cam, fx: 3}\n")
    assert read_mapping(tmp_path / "a.yaml")["right"] == {"fx": 3, "fy": 2}


def test_a_long_file_is_not_parsed(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("#" * (MAX_BYTES + 1))
    with pytest.raises(InputError, match="larger than 256 kB"):
        read_mapping(tmp_path / "a.yaml")


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_other_encodings_are_named(encoding: str, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_bytes("name: Rüfüs\n".encode(encoding))
    with pytest.raises(InputError, match="line 1: it is not a text file in UTF-8"):
        read_mapping(tmp_path / "a.yaml")
