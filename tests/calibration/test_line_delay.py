"""The line delay of a rolling shutter, from corners of a board before a moving camera."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.calibration.calibrate import calibrate
from ispom.calibration.detection.detection import Detection
from ispom.calibration.result import Calibration, Views
from ispom.calibration.targets.layouts import parse_target
from ispom.simulation.filmed_board import Filming, filming_rig

TARGET = parse_target("chessboard:9x6:0.03")
FILM = Filming.of(filming_rig(), TARGET.size_m, 12.0, 0)
CAMERA = FILM.rig.camera("video")
RATE_HZ, EVERY = 30.0, 15
NOISE_PX = 0.1


def corners(time_s: float, delay_s: float, rng: np.random.Generator) -> Detection:
    """Each at the time at which its own row is exposed: by a parabola through the first, middle and last row's."""
    middle = (CAMERA.height - 1) / 2
    poses = [FILM.video_from_board_at(time_s + delay_s * k * middle) for k in (-1, 0, 1)]
    first, now, last = (CAMERA.project(pose.apply(TARGET.xyz_in_board)) for pose in poses)
    uv = now
    for _ in range(3):
        k = (uv[:, 1:] - middle) / middle
        uv = now + k * (last - first) / 2 + k**2 * (first + last - 2 * now) / 2
    inside = ((uv > 0) & (uv < (CAMERA.width - 1, CAMERA.height - 1))).all(1)
    ids = np.flatnonzero(inside)
    seen = uv[ids] + NOISE_PX * rng.standard_normal((len(ids), 2))
    found = Detection.of(ids, seen, np.full(len(ids), NOISE_PX))
    return found if len(ids) >= 20 else Detection(reason="not in the image")


def filmed(delay_s: float, seed: int) -> tuple[Views, Views]:
    """Views, and the images around them."""
    rng = np.random.default_rng(seed)
    times = np.arange(3, int(RATE_HZ * FILM.duration_s) - 3)
    chosen = times[::EVERY]
    index = np.unique(chosen[:, None] + np.arange(-2, 3))
    seen = {i: corners(i / RATE_HZ, delay_s, rng) for i in index.tolist()}
    size = (CAMERA.width, CAMERA.height)

    def of(images: np.ndarray) -> Views:
        names, found = tuple(f"{i:04d}" for i in images), tuple(seen[i] for i in images.tolist())
        return Views("video", size, names, found, np.rint(images / RATE_HZ * 1e9).astype(np.int64))

    return of(chosen), of(index)


def calibrated(delay_s: float, seed: int = 0, told: bool = True) -> Calibration:
    views, around = filmed(delay_s, seed)
    return calibrate(TARGET, (views,), "radtan", around=around if told else None)


@pytest.mark.parametrize("delay_s", [30e-6, -20e-6])
def test_the_delay_is_found_and_the_camera_without_it(delay_s: float) -> None:
    blind, found = calibrated(delay_s, told=False), calibrated(delay_s)
    delay = found.line_delay
    assert delay is not None and delay.rolls
    assert found.rig.camera("video").line_delay_s == delay.seconds
    assert abs(delay.seconds - delay_s) < min(3 * delay.standard_error_s, 1e-6)
    assert blind.solution.rms_px > 1.5 * found.solution.rms_px
    assert found.solution.rms_px == pytest.approx(np.sqrt(2) * NOISE_PX, rel=0.25)
    wrong, right = (abs(each.cameras[0].camera.fx - CAMERA.fx) for each in (blind, found))
    assert right < 1 < 3 < wrong


def test_a_global_shutter_is_called_one_and_nothing_is_corrected() -> None:
    found, plain = calibrated(0.0), calibrated(0.0, told=False)
    delay = found.line_delay
    assert delay is not None and not delay.rolls and delay.standard_error_s < 1e-6
    assert found.cameras[0].camera == plain.cameras[0].camera and plain.line_delay is None


def test_standard_errors_are_right_over_seeds() -> None:
    found = [calibrated(30e-6, seed).line_delay for seed in range(6)]
    away = np.array([(d.seconds - 30e-6) / d.standard_error_s for d in found if d is not None])
    assert len(away) == 6 and np.abs(away).max() < 3.5 and np.sqrt((away**2).mean()) < 1.7


def test_a_camera_that_stood_still_says_nothing() -> None:
    views, around = filmed(0.0, 0)
    apart = Views("video", around.size, around.images, around.detections, 10**10 * np.arange(len(around.images)))
    assert calibrate(TARGET, (views,), "radtan", around=apart).line_delay is None


def test_without_noise_the_delay_is_nearly_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(f"{__name__}.NOISE_PX", 0.001)
    found = calibrated(30e-6)
    assert found.line_delay is not None
    assert found.line_delay.seconds == pytest.approx(30e-6, rel=0.003)
    assert found.cameras[0].camera.fx == pytest.approx(CAMERA.fx, abs=0.02)
