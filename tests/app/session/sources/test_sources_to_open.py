"""What the page offers to open: sources opened before, and folders that may be looked into."""

from __future__ import annotations

import errno
import os
from dataclasses import replace
from pathlib import Path

import pytest
from ispom_app.engine.options import SourceOptions
from ispom_app.engine.playback import builder_within
from ispom_app.session import commands as do
from ispom_app.session.sources.folders import MOST, Folders, RecentSources
from ispom_app.session.sources.opening import SourceOpener

from ispom.ensemble import build
from ispom.errors import InputError
from ispom.estimators.survey.panorama import PanoramaConfig
from ispom.methods import GROUPS, Config, possible_methods
from ispom.sequences import open_sequence
from ispom.types import Guess
from tests.app.helpers import opener, started, wait_for


def test_recent_sources_are_kept_newest_first_without_passwords(tmp_path: Path):
    path = tmp_path / "config" / "recent.json"
    for source in ("sim:city", "rtsp://me:secret@cam/1", "sim:city"):
        RecentSources(path).add(source)
    assert RecentSources(path).names == ("sim:city", "rtsp://cam/1") and "secret" not in path.read_text()
    for i in range(2 * MOST):
        RecentSources(path).add(f"sim:city#{i}")
    assert len(RecentSources(path).names) == MOST


def test_a_damaged_or_unwritable_list_of_recent_sources_harms_nobody(tmp_path: Path):
    path = tmp_path / "recent.json"
    path.write_text("{broken")
    assert RecentSources(path).names == ()
    path.write_text('{"not": "a list"}')
    assert RecentSources(path).names == ()
    path.write_text('["caf\\udce9", "sim:city", 3]')
    assert RecentSources(path).names == ("sim:city",)  # the other no page can show
    assert RecentSources(tmp_path / "recent.json" / "below-a-file").add("sim:city") == ("sim:city",)


def test_where_the_folder_that_the_app_was_started_in_is_gone_it_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """That was taken for a fault of the standard output."""
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(InputError, match="is gone"):
        _ = Folders().home
    assert Folders(tmp_path).home == tmp_path


def test_folders_are_listed_below_the_root_only(tmp_path: Path):
    root = tmp_path / "root"
    (root / "drive").mkdir(parents=True)
    (root / ".hidden").mkdir()
    (root / "link").symlink_to(tmp_path)
    folders = Folders(root)
    assert [entry.path.name for entry in folders.entries(folders.home)] == ["drive"]
    assert folders.above(folders.home) is None and folders.above(root / "drive") == root
    assert folders.entries(tmp_path) == []


def test_what_is_recognised_is_distinguished_from_folders_to_look_into(tmp_path: Path):
    (tmp_path / "film.mp4").write_bytes(b"")
    (tmp_path / "notes.txt").write_text("")
    for name in ("walk", "films", "more"):
        (tmp_path / name).mkdir()
    for name in ("walk/a.mp4", "films/a.mp4", "films/b.mp4"):
        (tmp_path / name).write_bytes(b"")
    found = {entry.path.name: entry.source for entry in Folders(tmp_path).entries(tmp_path)}
    assert found == {"film.mp4": True, "films": False, "more": False, "walk": True}


def test_files_are_listed_where_a_run_would_open_them(tmp_path: Path):
    texts = {
        "camera.yaml": "{width: 96, height: 64, fx: 80, fy: 80, cx: 47.5, cy: 31.5}",
        "rig.yaml": "video: {width: 96, height: 64, fx: 80, fy: 80, cx: 47.5, cy: 31.5, distortion: []}",
        "notes.yaml": "[1, 2]",
        "broken.yaml": "video: [",
        "roof.yaml": "video: {source: film.mp4}",
        "roof.yml": "{left: left, right: right}",
        "storm.yaml": "scene: city",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    listed = {entry.path.name for entry in Folders(tmp_path).entries(tmp_path)}
    assert listed == {"roof.yaml", "roof.yml", "storm.yaml"}
    for name in texts.keys() - listed:
        with pytest.raises(InputError, match=name.replace(".", r"\.")):
            open_sequence(str(tmp_path / name))


def test_what_cannot_be_looked_at_does_not_keep_the_others_from_being_listed(tmp_path: Path):
    """The app did not even start where a link led nowhere."""
    for name in ("walk", "described", "loops"):
        (tmp_path / name).mkdir()
    (tmp_path / "film.mp4").write_bytes(b"")
    (tmp_path / "gone").symlink_to("/nowhere")
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "described" / "sequence.yaml").symlink_to("/nowhere")
    (tmp_path / "loops" / "calib.txt").symlink_to("calib.txt")
    for folders in (Folders(tmp_path), Folders()):
        found = {entry.path.name: entry.source for entry in folders.entries(tmp_path)}
        assert found == {"described": False, "film.mp4": True, "loops": False, "walk": False}
        assert folders.entries(tmp_path / "loop") == folders.entries(tmp_path / "gone") == []


def test_a_folder_that_may_not_be_read_does_not_either(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for name in ("locked", "walk"):
        (tmp_path / name).mkdir()
    stat = Path.stat

    def locked(self: Path, **options: bool) -> os.stat_result:  # as for all but the superuser, who may run this
        if self.parent.name == "locked":
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(self))
        return stat(self, **options)

    monkeypatch.setattr(Path, "stat", locked)
    found = {entry.path.name: entry.source for entry in Folders(tmp_path).entries(tmp_path)}
    assert found == {"locked": False, "walk": False}


def test_what_a_page_cannot_name_is_not_listed(tmp_path: Path):
    """viser has no message for such a name: the page had no panels at all."""
    for name in (b"walk", b"caf\xe9", b"caf\xe9/inner"):
        os.mkdir(os.fsencode(tmp_path) + b"/" + name)
    folders = Folders(tmp_path)
    assert [entry.path.name for entry in folders.entries(tmp_path)] == ["walk"]
    assert folders.entries(tmp_path / os.fsdecode(b"caf\xe9")) == []


def test_files_of_no_known_kind_are_passed_over_by_their_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Each was asked for what a drive holds, and for more: of 100 000 files, that took longer than anybody waits."""
    for name in ("a.txt", "b.jpg", "c.csv"):
        (tmp_path / name).touch()
    stat, inspected = Path.stat, list[Path]()
    monkeypatch.setattr(Path, "stat", lambda self, **options: (inspected.append(self), stat(self, **options))[1])
    assert Folders(tmp_path).entries(tmp_path) == []
    assert not [path for path in inspected if path.parent.parent == tmp_path]


def test_what_is_opened_in_the_page_plays_by_itself_with_its_options(tmp_path: Path):
    opened_options: list[SourceOptions | None] = []

    def remembering(source: str, options: SourceOptions | None = None):
        opened_options.append(options)
        return opener(source)

    session = started(tmp_path, opener=remembering, autoplay=False)
    wait_for(lambda: session.state.phase == "ready", "the first source")
    assert not session.state.playing
    session.post(do.Open("double:5", SourceOptions(stereo_every=3)))
    wait_for(lambda: session.state.run == 2 and session.state.ended, "the second source to play to its end")
    assert opened_options == [None, SourceOptions(stereo_every=3)]
    assert session.state.source_options.stereo_every == 3
    assert session.state.recent == ("double:5", "double:20")
    session.close(1.0)


def test_finding_a_camera_that_has_no_calibration_is_reported():
    def unknown(source: str, options: SourceOptions | None = None):
        return replace(opener(source), guess=Guess(224.0, 0.3, "a guess"))

    messages: list[str] = []
    source = SourceOpener(unknown, build, "modern")
    source.playback("double:3", None, None, Config(), strict=False, progress=messages.append)
    SourceOpener(opener, build, "modern").playback(
        "double:3", None, None, Config(), strict=False, progress=messages.append
    )
    assert len(messages) == 1 and messages[0].startswith("double:3")


@pytest.mark.parametrize("strict", [True, False])
def test_a_group_of_methods_is_those_that_the_source_has_the_cameras_for(strict: bool) -> None:
    source = SourceOpener(opener, build, "modern")
    playback = source.playback("double:3", None, ("paper",), Config(), strict=strict, progress=lambda _: None)
    assert playback.methods == tuple(n for n in GROUPS["paper"] if n in possible_methods(playback.sequence.rig))


def test_a_setting_names_no_folder_outside_of_the_root(tmp_path: Path) -> None:
    """But for that of the command line; a link out of the root leads nowhere."""
    root, elsewhere, sequence = tmp_path / "root", tmp_path / "elsewhere", open_sequence("sim:tiny")
    for folder in (root, elsewhere, root / "inner"):
        folder.mkdir()
    (root / "link").symlink_to(elsewhere)

    def fault(folder: Path, named: Path | None = None) -> str:
        config = Config({"panorama": PanoramaConfig(reference=str(folder))})
        given = Config() if named is None else Config({"panorama": PanoramaConfig(reference=str(named))})
        with pytest.raises(InputError) as found:
            builder_within((root,), given, build)(config, ("panorama",), sequence.rig)
        return str(found.value)

    assert "outside" in fault(elsewhere) and "outside" in fault(root / "link")
    assert "outside" not in fault(root / "inner") and "outside" not in fault(elsewhere, elsewhere)
    assert builder_within(None, Config(), build) is build
