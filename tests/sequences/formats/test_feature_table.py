"""Tables of IMU samples and tracked points: what is drawn, what is measured, and what is wrong with a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences import open_sequence
from ispom.sequences.formats.feature_table import COLUMNS, TABLE, drawn
from ispom.types import Frame, ImuSamples

META = {
    "camera_fx": 100.0,
    "camera_fy": 100.0,
    "camera_cx": 60.0,
    "camera_cy": 40.0,
    "T_ci_tx": 0.1,
    "T_ci_ty": 0.0,
    "T_ci_tz": 0.0,
    "T_ci_qx": 0.0,
    "T_ci_qy": 0.0,
    "T_ci_qz": 0.0,
    "T_ci_qw": 1.0,
    "eqf.input_var_gyr": 4e-6,
}


def row(**values: object) -> str:
    return ",".join(str(values.get(name, "")) for name in COLUMNS)


def table(folder: Path, *changes: tuple[str, str]) -> Path:
    lines = [",".join(COLUMNS), *(row(row_type="meta", key=k, value=v) for k, v in META.items())]
    for k in range(5):
        time = f"{1403715273.25 + 0.05 * k:.4f}"
        lines += [row(row_type="vision_feature", t_abs=time, landmark_id=i, u_norm=0.2 * i, v_norm=0.1) for i in (1, 2)]
        axes = dict(zip(COLUMNS[3:9], (0.0, 0.0, 0.1, 0.0, 0.0, 9.8), strict=True))
        lines += [row(row_type="imu", t_abs=time, **axes)]
    text = "\n".join(lines) + "\n"
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (folder / TABLE).write_text(text)
    (folder / "truth.tum").write_text("1403715273.2 0 0 0 0 0 0 1\n1403715273.28 1 0 0 0 0 0 1\n")
    return folder


def test_points_are_drawn_where_they_are(tmp_path: Path) -> None:
    sequence = open_sequence(str(table(tmp_path)))
    camera = sequence.rig.camera("video")
    frames = [m for m in (sequence[i] for i in range(len(sequence))) if isinstance(m, Frame)]
    assert len(frames) == 5
    for i in (1, 2):
        u, v = 0.2 * i * camera.fx + camera.cx, 0.1 * camera.fy + camera.cy
        image = frames[0].image[round(v) - 4 : round(v) + 5, round(u) - 4 : round(u) + 5].astype(float)
        rows, columns = np.mgrid[round(v) - 4 : round(v) + 5, round(u) - 4 : round(u) + 5]
        assert (rows * image).sum() / image.sum() == pytest.approx(v, abs=0.05)
        assert (columns * image).sum() / image.sum() == pytest.approx(u, abs=0.05)


def test_the_imu_and_the_truth_are_those_of_the_body(tmp_path: Path) -> None:
    sequence = open_sequence(str(table(tmp_path)))
    samples = [m for m in (sequence[i] for i in range(len(sequence))) if isinstance(m, ImuSamples)]
    assert sum(len(m.times_ns) for m in samples) == 5
    assert samples[0].specific_force_m_s2[0, 2] == 9.8 and samples[0].angular_velocity_rad_s[0, 2] == 0.1
    assert sequence.rig.rig_from_video.translation[0] == 0.1
    assert sequence.rig.sensors["imu"].gyroscope_noise == pytest.approx(2e-3)  # type: ignore[attr-defined]
    assert sequence.truth is not None and len(sequence.truth) == 1


def test_a_spot_lies_between_pixels() -> None:
    image = drawn(np.array([[20.5, 10.0]]), np.array([7]), (40, 20))
    assert image[10, 20] == image[10, 21] > image[10, 22] > 0 and image.dtype == np.uint8
    assert not drawn(np.zeros((0, 2)), np.zeros(0, np.int64), (40, 20)).any()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (("row_type,", "type,"), "has no column row_type"),
        (("camera_fx", "camera_fz"), "has no meta row with the key camera_fx"),
        (("camera_fx,100.0", "camera_fx,-1"), "needs a positive focal length"),
        (("vision_feature", "dream"), "line 14 is of the type 'dream'"),
        (("1403715273.3000", "1403715273.2000"), "its time is not after the one before"),
        (("0.4,0.1", "0.4,x"), "line 15"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, change: tuple[str, str], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        open_sequence(str(table(tmp_path, change)))
