"""YAML files: short texts that stand for much, or for nothing of the kind, are refused before they cost anything."""

from __future__ import annotations

from pathlib import Path

import pytest

from ispom.errors import InputError
from ispom.io.mapping import MAX_BYTES, finite_numbers, read_mapping


def laughs(merged: bool) -> str:
    """Ten lines of aliases that stand for ten thousand million values."""
    first = "l0: &l0 {x: 1}\n" if merged else "l0: &l0 [x]\n"
    lines = [f"&l{i} {{<<: [{', '.join([f'*l{i - 1}'] * 10)}]}}" for i in range(1, 11)]
    if not merged:
        lines = [f"&l{i} [{', '.join([f'*l{i - 1}'] * 10)}]" for i in range(1, 11)]
    return first + "".join(f"l{i}: {line}\n" for i, line in enumerate(lines, 1))


@pytest.mark.parametrize(
    "text",
    [laughs(False), laughs(True), "a: &a [*a]", "a: " + "[" * 200 + "]" * 200, "- x\n" * 24_000],
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


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("fx: 80\nfy: 80\nfx: 90\n", "line 3: fx is given twice: remove one"),
        ("left: {k: 1}\nright: {k: 1,\n  k: 1}\n", "line 3: k is given twice: remove one"),
    ],
)
def test_a_value_that_is_given_twice_is_refused(text: str, told: str, tmp_path: Path) -> None:
    """The last one counted, without a word."""
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(InputError, match=f"a.yaml {told}"):
        read_mapping(tmp_path / "a.yaml")


def test_what_is_merged_may_be_given_again(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("a: &a {x: 1}\nb: &b {y: 1}\nc: {<<: *a, <<: *b, x: 2, 1: 3, '1': 4}\n")
    assert read_mapping(tmp_path / "a.yaml")["c"] == {"x": 2, "y": 1, 1: 3, "1": 4}


@pytest.mark.parametrize("word", ["1e-05", "-1E5", "2e+3", "1.5e3", ".5e2", "+3.e1"])
def test_numbers_as_programs_write_them_are_numbers(word: str, tmp_path: Path) -> None:
    """YAML 1.1, which is read here, has none such without a point and a sign: they were words."""
    (tmp_path / "a.yaml").write_text(f"k: [{word}]\n")
    assert finite_numbers(tmp_path, "k", read_mapping(tmp_path / "a.yaml")["k"], 1) == [float(word)]


@pytest.mark.parametrize("word", ["1e999", "'80'", "1e", "e5", "1_0e2", "nan", "0x1e5g", "١e5", "1e5 px"])
def test_words_are_not(word: str, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(f"k: [{word}]\n")
    with pytest.raises(InputError, match="k needs 1 finite number"):
        finite_numbers(tmp_path, "k", read_mapping(tmp_path / "a.yaml")["k"], 1)


def test_a_long_file_is_not_parsed(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("#" * (MAX_BYTES + 1))
    with pytest.raises(InputError, match="larger than 256 kB"):
        read_mapping(tmp_path / "a.yaml")


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_other_encodings_are_named(encoding: str, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_bytes("name: Rüfüs\n".encode(encoding))
    with pytest.raises(InputError, match=r"line 1: .*UTF-8"):
        read_mapping(tmp_path / "a.yaml")
