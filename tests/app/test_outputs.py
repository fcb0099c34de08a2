"""What a command writes replaces its own earlier output, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest
from ispom_app.engine.outputs import MARKER, claim_folder, write_file

from ispom.errors import InputError


def test_a_file_of_the_same_kind_is_replaced(tmp_path: Path) -> None:
    place = tmp_path / "new" / "a.json"
    (tmp_path / "new").mkdir()
    place.touch()
    for content in ("kind: 1", "kind: 2"):
        write_file(place, content, "kind:")
    assert place.read_text() == "kind: 2"


@pytest.mark.parametrize("content", [b"notes of mine", b"\xff" * 5000, b" " * 5000 + b"kind:"])
def test_a_file_of_the_users_stays(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.json").write_bytes(content)
    with pytest.raises(InputError, match="earlier output"):
        write_file(tmp_path / "a.json", "kind: 2", "kind:")
    assert (tmp_path / "a.json").read_bytes() == content


def test_a_folder_or_a_dangling_link_in_the_way_stays(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for name in ("folder", "link"):
        with pytest.raises(InputError):
            write_file(tmp_path / name, "kind: 2", "kind:")
    assert (tmp_path / "folder").is_dir() and (tmp_path / "link").is_symlink()


def test_a_folder_is_taken_new_empty_or_ours(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for name in ("new/deep", "empty", "empty"):
        claim_folder(tmp_path / name, "export tum")
        (tmp_path / name / "stereo.tum").write_text("0")
    with pytest.raises(InputError, match="is not empty"):
        claim_folder(tmp_path / "empty", "export csv")


def test_a_folder_with_anything_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "stereo.tum").write_text("mine")
    with pytest.raises(InputError, match=r"holds stereo\.tum"):
        claim_folder(tmp_path / "mine", "export tum")
    assert not (tmp_path / "mine" / MARKER).exists()
    with pytest.raises(InputError, match="cannot be created"):
        claim_folder(tmp_path / "mine" / "stereo.tum", "export tum")
