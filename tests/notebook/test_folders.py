"""`run.save` and `ispom.read_run`: a run that comes back from its folder as it was, and that all else opens."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ispom_app.features.headless.command import completed
from ispom_app.features.headless.console import silent
from ispom_app.features.headless.options import Run as Options

import ispom

FRAMES = 30


def folder_files(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@pytest.mark.parametrize("method", ["stereo", "monocular", "integrated"])
def test_what_is_saved_is_read_again(method: str, tmp_path: Path) -> None:
    run = ispom.run("sim:tiny", method, frames=FRAMES)
    folder = run.save(tmp_path / "saved")
    found = ispom.read_run(folder)
    assert (found.method, found.source, found.located.tolist()) == (method, run.source, run.located.tolist())
    assert found.trajectory.times_ns.tolist() == run.trajectory.times_ns.tolist()
    np.testing.assert_allclose(found.trajectory.translations, run.trajectory.translations, atol=1e-8)
    assert [step.inliers for step in found.steps] == [step.inliers for step in run.steps]
    for mine, stored in zip(run.steps, found.steps, strict=True):
        if mine.world_from_frame is not None:
            np.testing.assert_array_equal(stored.world_from_frame.translation, mine.world_from_frame.translation)
    assert found.evaluate().ate == pytest.approx(run.evaluate().ate, rel=1e-4)
    assert 20 < len(repr(found)) < 200 and "ATE" in found._repr_html_()


def test_it_is_the_folder_that_the_command_writes(tmp_path: Path) -> None:
    saved = ispom.run("sim:tiny", "integrated", frames=FRAMES).save(tmp_path / "saved")
    options = Options(source="sim:tiny", methods=("integrated",), max_exposures=FRAMES, out=tmp_path / "run")
    written = completed(options, progress=silent).folder.path
    assert folder_files(saved) == folder_files(written)
    for name in ("integrated.tum", "truth.tum", "decisions.csv", "events.csv"):
        assert (saved / name).read_bytes() == (written / name).read_bytes(), name
    both: list[dict[str, Any]] = [json.loads((folder / "metrics.json").read_text()) for folder in (saved, written)]
    for report in both:
        del report["methods"]["integrated"]["ms_per_exposure"]
    assert both[0].keys() == both[1].keys() - {"cpu_ms_per_exposure", "peak_memory_mb"}
    assert both[0]["methods"] == both[1]["methods"]


def test_images_of_a_notebook_are_saved_too(tmp_path: Path) -> None:
    sequence = ispom.open_sequence("sim:tiny", max_exposures=FRAMES)
    video: list[Any] = [sequence[i] for i in range(FRAMES) if sequence.kinds[i] == "video"]
    run = ispom.run([frame.image for frame in video], "monocular", rig=sequence.rig)
    found = ispom.read_run(run.save(tmp_path / "images"))
    assert len(found.steps) == len(video) and found.truth is None
    with pytest.raises(ispom.InputError, match="ground truth"):
        found.evaluate()
    assert len(found.plot().axes) == 1


def test_a_mistake_is_one_sentence(tmp_path: Path) -> None:
    run = ispom.run("sim:tiny", "stereo", frames=FRAMES)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "letter.txt").write_text("mine")
    with pytest.raises(ispom.InputError, match=r"letter\.txt"):
        run.save(tmp_path / "full")
    assert folder_files(tmp_path / "full") == {"letter.txt"}
    with pytest.raises(ispom.InputError, match="holds no run"):
        ispom.read_run(tmp_path / "nothing")
    with pytest.raises(ispom.InputError, match="stereo"):
        ispom.read_run(run.save(tmp_path / "saved"), "monocular")


def test_of_several_methods_one_is_chosen(tmp_path: Path) -> None:
    options = Options(source="sim:tiny", methods=("stereo", "monocular"), max_exposures=FRAMES, out=tmp_path / "run")
    completed(options, progress=silent)
    with pytest.raises(ispom.InputError, match="monocular, stereo"):
        ispom.read_run(tmp_path / "run")
    assert ispom.read_run(tmp_path / "run", "stereo").method == "stereo"
