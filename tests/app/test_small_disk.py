"""A disk that fills up costs what does not fit: never the run, and never a wait."""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from ispom_app.cli.main import main
from ispom_app.engine.run_folder.run_folder import MARKER
from ispom_app.views.rerun import file_recording
from ispom_app.views.rerun.rrd import is_finished

from ispom.io.trajectories import read_tum
from tests.app import helpers
from tests.sequences.kitti_folder import make_drive

SIZES_KB = (64, 100, 150, 200, 250, 300, 350, 400, 450, 500, 550, 600, 650, 700, 800, 1000, 1500)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Callable[[int], Path]]:
    """Mounts a disk of `size_kb`; skips the test where that is not allowed."""
    place = tmp_path / "disk"
    place.mkdir()

    def mount(size_kb: int) -> Path:
        arguments = ["mount", "-t", "tmpfs", "-o", f"size={size_kb}k", "tmpfs", str(place)]
        try:
            subprocess.run(arguments, capture_output=True, check=True)
        except (OSError, subprocess.CalledProcessError):
            pytest.skip("a small disk can be mounted by root on Linux only")
        return place

    yield mount
    subprocess.run(["umount", str(place)], capture_output=True, check=False)


@pytest.mark.timeout(60)
@pytest.mark.parametrize("reserve", [0, file_recording.RESERVE_BYTES])
@pytest.mark.parametrize("size_kb", SIZES_KB)
def test_a_run_onto_a_small_disk_ends_and_says_what_is_missing(
    size_kb: int,
    reserve: int,
    disk: Callable[[int], Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(file_recording, "RESERVE_BYTES", reserve)
    out = disk(size_kb) / "out"
    code = main(["run", str(make_drive(tmp_path / "kitti", frames=8)), "--out", str(out)], helpers.build)
    message = capsys.readouterr().err
    if code == 0:
        assert reserve == 0 and is_finished(out / "run.rrd") and not (out / MARKER).exists()
        return
    assert code == 2 and message.count("\n") == 1 and ("run.rrd ends early" in message)
    assert (out / MARKER).exists()
    for path in (out / f"{method}.tum" for method in ("monocular", "stereo", "integrated")):
        assert len(read_tum(path)) >= 8 if path.exists() else f"{path.name}" in message
