"""Which clips a folder holds."""

from __future__ import annotations

from pathlib import Path

from ispom_app.features.triage.clips import LINKED, clips_in, stamp

from tests.sequences.kitti_folder import make_drive


def named(folder: Path) -> dict[str, str]:
    return {clip.name: clip.problem for clip in clips_in(folder, folder / "out")}


def test_clips_are_found_at_any_depth_and_what_belongs_to_them_is_none(tmp_path: Path) -> None:
    make_drive(tmp_path / "one")  # its poses lie beside it
    make_drive(tmp_path / "day 2" / "Übung <b>&")
    (tmp_path / "day 2" / "film.mp4").write_text("no film")
    (tmp_path / "day 2" / "notes").mkdir()
    (tmp_path / "day 2" / "notes" / "read.txt").write_text("nothing")
    (tmp_path / "lens.yaml").write_text("fx: [")
    (tmp_path / ".hidden.mp4").write_text("")
    assert named(tmp_path) == {
        "one/sequences/07": "", "day 2/Übung <b>&/sequences/07": "", "day 2/film.mp4": ""
    }  # fmt: skip


def test_an_empty_folder_and_an_archive_are_clips_that_cannot_be_opened(tmp_path: Path) -> None:
    make_drive(tmp_path / "one")
    (tmp_path / "empty").mkdir()
    (tmp_path / "all.zip").write_text("")
    assert list(named(tmp_path)) == ["all.zip", "empty", "one/sequences/07"]


def test_a_folder_of_one_film_is_a_clip_and_of_a_film_and_other_clips_is_none(tmp_path: Path) -> None:
    film = tmp_path / "a" / "film.mp4"
    film.parent.mkdir()
    film.write_text("")
    assert list(named(tmp_path)) == ["a"]
    make_drive(tmp_path / "a" / "more")
    assert list(named(tmp_path)) == ["a/film.mp4", "a/more/sequences/07"]


def test_links_are_not_followed_and_one_that_leads_out_is_listed(tmp_path: Path) -> None:
    folder, outside = tmp_path / "clips", make_drive(tmp_path / "outside")
    make_drive(folder / "one")
    (folder / "away").symlink_to(outside)
    (folder / "again").symlink_to(folder / "one")
    (folder / "loop").symlink_to(folder)
    assert named(folder) == {"away": LINKED, "one/sequences/07": ""}


def test_the_folder_may_be_the_clip_and_output_is_left_out(tmp_path: Path) -> None:
    drive = make_drive(tmp_path / "one")
    assert list(named(drive)) == ["07"]
    make_drive(tmp_path / "out" / "run")
    assert list(named(tmp_path)) == ["one/sequences/07"]


def test_files_of_clips_have_different_plain_names(tmp_path: Path) -> None:
    for name in ("a b", "a-b", "a&b", "ü"):
        (tmp_path / f"{name}.mp4").write_text("")
    keys = [clip.key for clip in clips_in(tmp_path, tmp_path / "out")]
    assert len(set(keys)) == 4 and all(key.isascii() and " " not in key for key in keys)


def test_a_changed_clip_has_another_stamp(tmp_path: Path) -> None:
    drive = make_drive(tmp_path / "one")
    (clip,) = clips_in(tmp_path, tmp_path / "out")
    before = stamp(clip)
    (drive / "times.txt").write_text("0\n")
    assert before and stamp(clip) not in ("", before)
