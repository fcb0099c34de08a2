"""What is written is what was cut, to the last bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ispom_app.engine.options import SourceOptions
from ispom_app.features.shrink.cut import cameras_of, cut, frame_times
from ispom_app.features.shrink.search import Clip
from ispom_app.features.shrink.write import SENSOR_FILE, require_empty, write_recording, zipped

from ispom.errors import InputError
from ispom.types import Frame, Sequence, images_of
from tests import doubles

BOTH = Clip(tuple(range(20)), ("monocular", "stereo"), ("stereo", "video"))


def same_frames(written: Sequence, part: Sequence, kinds: set[str]) -> None:
    own = [[m for m in map(each.load, range(len(each))) if m.kind in kinds] for each in (written, part)]
    assert [(m.time_ns, m.kind) for m in own[0]] == [(m.time_ns, m.kind) for m in own[1]]
    for a, b in zip(*own, strict=True):
        for name, image in images_of(b).items():
            assert np.array_equal(images_of(a)[name], image)


@pytest.mark.parametrize("halvings", [0, 1])
def test_a_folder_opens_as_the_clip(tmp_path: Path, halvings: int) -> None:
    clip = replace(BOTH, frames=(5, 6, 7, 9, 11, 12, 13, 17), halvings=halvings)
    part = cut(doubles.sequence(), clip)
    write_recording(tmp_path, part)
    written = SourceOptions().open(str(tmp_path))
    assert written.times_ns.tolist() == part.times_ns.tolist() and written.kinds == part.kinds
    same_frames(written, part, {"video", "stereo"})
    for name in ("video", "left", "right"):
        assert written.rig.camera(name) == part.rig.camera(name)
        assert np.allclose(written.rig.rig_from(name).matrix, part.rig.rig_from(name).matrix, atol=1e-12)
    assert written.truth is None and part.truth is None


def test_cameras_that_are_dropped_are_not_written(tmp_path: Path) -> None:
    whole = doubles.sequence(40)
    for kind, inner in (("video", ["video"]), ("stereo", ["left", "right"])):
        method = {"video": "monocular", "stereo": "stereo"}[kind]
        part = cut(
            whole, replace(BOTH, methods=(method,), cameras=(kind,), frames=tuple(range(len(frame_times(whole)))))
        )
        folder = tmp_path / kind
        write_recording(folder, part)
        assert sorted(p.name for p in folder.iterdir() if p.is_dir()) == inner
        same_frames(SourceOptions().open(str(folder)), part, {kind})


def test_times_keep_every_nanosecond(tmp_path: Path) -> None:
    whole = doubles.sequence()
    late = 1_403_636_579_763_555_584

    def load(i: int) -> Frame:
        measured = whole.load(i)
        assert isinstance(measured, Frame)
        return replace(measured, time_ns=measured.time_ns + late)

    part = cut(replace(whole, times_ns=whole.times_ns + late, load=load), BOTH)
    write_recording(tmp_path, part)
    assert SourceOptions().open(str(tmp_path)).times_ns.tolist() == part.times_ns.tolist()


def test_other_sensors_are_written_where_a_method_uses_them(tmp_path: Path) -> None:
    whole = SourceOptions().open("sim:tiny?sensor=imu&sensor=gnss&sensor=wheel").truncated(200)
    clip = Clip(tuple(range(2, 13)), ("fused",), cameras_of(whole))
    part = cut(whole, clip)
    write_recording(tmp_path, part)
    written = SourceOptions(sensors=tmp_path / SENSOR_FILE).open(str(tmp_path))
    assert written.times_ns.tolist() == part.times_ns.tolist() and written.kinds == part.kinds
    for i, kind in enumerate(part.kinds):
        a, b = written.load(i), part.load(i)
        if kind == "imu":
            assert np.array_equal(a.specific_force_m_s2, b.specific_force_m_s2)  # type: ignore[attr-defined]
        if kind == "gnss":
            assert np.allclose(a.xyz_in_local, b.xyz_in_local, atol=0)  # type: ignore[attr-defined]
    without = cut(whole, replace(clip, methods=("stereo",)))
    assert set(without.kinds) == {"video", "stereo"} and set(without.rig.sensors) == {"left", "right", "video"}


def test_nothing_is_written_over_or_through_a_link(tmp_path: Path) -> None:
    full = tmp_path / "full"
    full.mkdir()
    (full / "own.txt").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    for folder in (full, full / "own.txt", tmp_path / "link"):
        with pytest.raises(InputError):
            require_empty(folder)
    assert (full / "own.txt").read_text() == "mine" and not (tmp_path / "elsewhere").exists()


def test_a_zip_has_the_same_bytes_for_the_same_files(tmp_path: Path) -> None:
    part = cut(doubles.sequence(), replace(BOTH, frames=(0, 1, 2, 3)))
    write_recording(tmp_path / "clip", part)
    assert zipped(tmp_path / "clip") == zipped(tmp_path / "clip")
