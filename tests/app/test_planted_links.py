"""Links in a folder that came from somebody else: no command writes through them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.engine.events import Bookmark
from ispom_app.engine.run_folder.run_folder import METRICS, NOTES, RunFolder
from ispom_app.engine.run_folder.step_log import StepLog
from ispom_app.features.bookmarks.notes import notes_of, put
from ispom_app.features.calibration.saved import save
from ispom_app.features.mapping.command import write_recording
from ispom_app.views.rerun.piped_file import PipedFile

from ispom.errors import InputError
from ispom.io.whole import part_of
from tests import doubles
from tests.app.strangers import complete_run, killed_run


@pytest.fixture
def precious(tmp_path: Path) -> Path:
    """A file of the user."""
    path = tmp_path / "precious"
    path.write_text("mine, without an end of line")
    return path


@pytest.fixture
def unchanged(precious: Path):
    """After the test it is as it was."""
    yield precious
    assert precious.read_text() == "mine, without an end of line"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return complete_run(tmp_path_factory.mktemp("whole"))


def test_a_bookmark(tmp_path: Path, unchanged: Path) -> None:
    part_of(tmp_path / NOTES).symlink_to(unchanged)
    put(notes_of(tmp_path), bookmarks=(Bookmark(1, 2, "seen"),))
    assert "seen" in (tmp_path / NOTES).read_text()


def test_the_tables_of_a_run(tmp_path: Path, unchanged: Path) -> None:
    with RunFolder(tmp_path / "run") as folder:
        for name in ("steps.csv", "decisions.csv", METRICS):
            part_of(folder.path / name).symlink_to(unchanged)
        with StepLog(folder):
            pass
        folder.write(METRICS, "{}")
        assert folder.problem is None


def test_a_recording(tmp_path: Path, unchanged: Path) -> None:
    part_of(tmp_path / "a.rrd").symlink_to(unchanged)
    file = PipedFile(part_of(tmp_path / "a.rrd"))
    file.opened()
    assert file.ended(20.0) and not part_of(tmp_path / "a.rrd").is_symlink()


def test_the_recording_of_a_map(tmp_path: Path, unchanged: Path) -> None:
    part_of(tmp_path / "map.rrd").symlink_to(unchanged)
    write_recording(tmp_path, tmp_path, "stereo", None, {})
    assert not (tmp_path / "map.rrd").is_symlink() and (tmp_path / "map.rrd").stat().st_size


@pytest.mark.parametrize("form", ["tum", "csv", "kitti", "euroc", "vslam-lab"])
def test_an_export(form: str, whole: Path, tmp_path: Path, unchanged: Path) -> None:
    out = tmp_path / "out"
    assert main(["export", str(whole), "--format", form, "--out", str(out)]) == 0
    for path in list(out.iterdir()):
        part_of(path).symlink_to(unchanged)
    assert main(["export", str(whole), "--format", form, "--out", str(out)]) == 0


@pytest.mark.parametrize("name", ["export", "export/tum"])
def test_an_export_into_a_folder_elsewhere(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run, elsewhere = complete_run(tmp_path), tmp_path / "elsewhere"
    elsewhere.mkdir()
    (run / name).parent.mkdir(exist_ok=True)
    (run / name).symlink_to(elsewhere)
    assert main(["export", str(run), "--format", "tum"]) == 2
    assert "is a link" in capsys.readouterr().err and not list(elsewhere.iterdir())


def test_a_calibration_into_a_folder_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "left").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="is a link"):
        save(doubles.rig(), None, "good", tmp_path / "out", "euroc")
    assert not list((tmp_path / "elsewhere").iterdir())


def test_a_report(whole: Path, tmp_path: Path, unchanged: Path) -> None:
    part_of(tmp_path / "report.html").symlink_to(unchanged)
    assert main(["report", str(whole), "--out", str(tmp_path / "report.html")]) == 0


@pytest.mark.parametrize("name", ["stereo.tum", "monocular.tum", "metrics.json", "INCOMPLETE"])
def test_what_repair_writes(name: str, tmp_path: Path, unchanged: Path) -> None:
    run = killed_run(tmp_path, recording=False)
    part_of(run / name).symlink_to(unchanged)
    assert main(["repair", str(run)]) == 0
    assert (run / name).is_file() and not (run / name).is_symlink()


@pytest.mark.parametrize("name", [".part-steps.csv", ".part-decisions.csv", ".part-run.rrd", "run.rrd"])
def test_what_repair_finishes(name: str, tmp_path: Path, precious: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = killed_run(tmp_path)
    if name.endswith(".rrd"):  # a recording of the user that is not finished
        precious.write_bytes((run / ".part-run.rrd").read_bytes())
    before = precious.read_bytes()
    (run / name).unlink(missing_ok=True)
    (run / name).symlink_to(precious)
    assert main(["repair", str(run)]) == 2
    assert "is a link" in capsys.readouterr().err and precious.read_bytes() == before


def test_a_run_over_an_incomplete_one(tmp_path: Path, unchanged: Path) -> None:
    run = killed_run(tmp_path, recording=False)
    for name in ("landmarks.npz", "thumbnail.jpg", "run.yaml"):
        (run / name).unlink(missing_ok=True)
        (run / name).symlink_to(unchanged)
        part_of(run / name).symlink_to(unchanged)
    with RunFolder(run) as folder:
        folder.write("landmarks.npz", np.zeros(3).tobytes())
        assert folder.problem is None
