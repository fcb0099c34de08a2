"""What `ispom run` suspects of a film at its end, and that it suspects nothing of a right one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ispom_app.engine.playback import Builder
from ispom_app.features.headless import suspicions

from ispom.evaluation.mirrored import MIRRORS
from ispom.features import pair_look
from ispom.io.rig import rig_text
from ispom.io.trajectories import tum_text
from ispom.types import is_video
from ispom.types.sequence import Guess
from tests.app import helpers
from tests.app.helpers import ran
from tests.film_variants import film
from tests.sequences.own_folders import write_images


def written(folder: Path, name: str, truth: bool = False) -> str:
    """A variant as a person has it on the disk."""
    sequence = film(name)
    write_images(folder / "video", [m.image for i in range(len(sequence)) if is_video(m := sequence.load(i))])
    (folder / "rig.yaml").write_text(rig_text(sequence.rig))
    (folder / "video.txt").write_text("".join(f"{t * 1e-9:.9f}\n" for t in sequence.times_ns))
    lines = ["video: {source: video, times: video.txt}"]
    if truth and sequence.truth is not None:
        (folder / "truth.tum").write_text(tum_text(sequence.truth))
        lines.append("truth: truth.tum")
    (folder / "sequence.yaml").write_text("\n".join(lines) + "\n")
    return str(folder)


def said(source: str, out: Path, capsys: pytest.CaptureFixture[str], builder: Builder = helpers.build) -> str:
    """What follows the line that names the run's folder."""
    ran(source, out, "--methods", "monocular", "--no-recording", builder=builder)
    return capsys.readouterr().out.partition(f"in {out}\n")[2]


def test_squeezed_images_are_suspected_with_the_command_for_more(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    line = said(written(tmp_path / "film", "squeezed in height"), out, capsys)
    assert line.count("\n") == 1 and "fy over fx" in line and f"`ispom doctor {out}`" in line


def test_a_right_film_is_not_spoken_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert said(written(tmp_path / "film", "as it was", truth=True), tmp_path / "out", capsys) == ""


@pytest.mark.parametrize(("words", "mirror"), [("", (1.0, 1.0, 1.0)), *MIRRORS.items()])
def test_a_mirrored_film_is_told_by_the_truth(words: str, mirror: tuple[float, float, float]) -> None:
    sequence = film("as it was")
    truth = sequence.truth
    assert truth is not None
    m = np.diag(mirror)
    path = replace(truth, rotations=m @ truth.rotations @ m, translations=truth.translations @ m, frame="video")
    found = suspicions.of_paths({"monocular": path}, truth, sequence.rig)
    assert (len(found), words in "".join(found)) == (bool(words), True)
    assert not suspicions.of_paths({"monocular": path}, None, sequence.rig)


def test_a_cut_beyond_what_is_looked_at_when_opening_is_suspected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pair_look, "FILM_IMAGES", 20)
    source = written(tmp_path / "film", "cut")
    assert "image 25 differs" in said(source, tmp_path / "out", capsys)
    monkeypatch.undo()
    assert "image 25 differs" not in said(source, tmp_path / "again", capsys), "it was said when it was opened"


def test_a_guess_of_the_calibration_is_not_suspected(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = list[str]()
    monkeypatch.setattr(suspicions, "diagnose", lambda seen, suspects, advance: asked.extend(s.key for s in suspects))
    sequence = film("as it was")
    suspicions.asked(sequence, [])
    assert {"video-focal", "zoom"} < set(asked) and not {"too-fast", "blur"} & set(asked)
    asked.clear()
    suspicions.asked(replace(sequence, guess=Guess(226, 0.3, "a guess")), [])
    assert asked == ["zoom"]
