"""What may be opened by whoever is not at the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.sequences.policy import SourcePolicy
from tests.sequences.folders import make_euroc
from tests.sequences.own_folders import CAMERA, make_described, make_images


def test_devices_and_addresses_only_where_allowed() -> None:
    for source, flag in (("camera:0", "--allow-devices"), ("rtsp://me:pw@cam.local/1", "--allow-network")):
        with pytest.raises(InputError, match=flag) as caught:
            open_sequence(source, policy=SourcePolicy(devices=False, network=False))
        assert "pw" not in str(caught.value)
        SourcePolicy().check(source)
    SourcePolicy(Path("/nowhere"), devices=False, network=False).check("sim:tiny")


def test_paths_outside_of_the_root_are_refused_whether_they_exist_or_not(tmp_path: Path) -> None:
    policy = SourcePolicy(tmp_path / "data")
    make_euroc(tmp_path / "data")
    (tmp_path / "data" / "link").symlink_to(make_euroc(tmp_path / "other"))
    assert len(open_sequence(str(tmp_path / "data" / "V9"), policy=policy))
    for path in ("other/V9", "other/nowhere", "data/../other", "data/link", "data/link/mav0"):
        with pytest.raises(InputError, match=r"outside of .*data"):
            open_sequence(str(tmp_path / path), policy=policy)


def test_files_that_a_recording_names_are_bounded_too(tmp_path: Path) -> None:
    described = make_described(tmp_path / "data" / "flight")
    (described / "rig.yaml").rename(tmp_path / "rig.yaml")
    (described / "rig.yaml").symlink_to(tmp_path / "rig.yaml")
    assert len(open_sequence(str(described)))
    with pytest.raises(InputError, match=r"rig.yaml"):
        open_sequence(str(described), policy=SourcePolicy(tmp_path / "data"))


def test_images_read_later_are_bounded_too(tmp_path: Path) -> None:
    folder = make_images(tmp_path / "data")
    (folder / "5.png").rename(tmp_path / "5.png")
    (folder / "5.png").symlink_to(tmp_path / "5.png")
    sequence = open_sequence(str(folder), policy=SourcePolicy(tmp_path / "data"))
    assert sequence[4] is not None
    with pytest.raises(InputError, match="outside"):
        sequence[5]


ROUTE = "".join(f"{0.1 * n:.1f} {0.1 * n:.1f} 0 0 0 0 0 1\n" for n in range(8))


@pytest.mark.parametrize("words", ["route={}/walk.tum", "mesh={}/room.obj&route=walk.tum", "route=link.tum"])
def test_files_that_the_words_of_a_simulation_name_are_bounded_too(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, outside = tmp_path / "data", tmp_path / "outside"
    for folder in (data, outside):
        folder.mkdir()
        (folder / "walk.tum").write_text(ROUTE)
    (outside / "room.obj").write_text("secret of the user\n")
    (outside / "secret.tum").write_text("secret of the user\n")
    (data / "link.tum").symlink_to(outside / "secret.tum")
    monkeypatch.chdir(data)
    for source in (f"sim:tiny?{words.format(outside)}", "walk.yaml"):
        (data / "walk.yaml").write_text(f"scene: tiny\nroute: {outside}/walk.tum\n")
        with pytest.raises(InputError, match="outside") as caught:
            open_sequence(source, policy=SourcePolicy(data))
        assert "secret of" not in str(caught.value)
    assert len(open_sequence("sim:tiny?route=walk.tum", policy=SourcePolicy(data)))


def test_a_calibration_that_the_command_line_names_is_allowed(tmp_path: Path) -> None:
    (tmp_path / "own.yaml").write_text(CAMERA)
    folder = make_images(tmp_path / "data")
    policy = SourcePolicy(tmp_path / "data", named=(tmp_path / "own.yaml",))
    assert len(open_sequence(str(folder), camera=tmp_path / "own.yaml", policy=policy))
