"""A single camera with known truth, as TUM RGB-D stores it: its error curve and the true path, aligned by Sim(3)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from ispom_app.engine.model.true_path import FIRST, TruePath
from ispom_app.features.branches.panel import BranchesPanel
from ispom_app.features.plots.page_message import error_curves
from ispom_app.session import commands as do
from ispom_app.session.branches.state import Branches
from ispom_app.session.session import Session
from ispom_app.session.setup import SessionSetup
from ispom_app.views.web.messages import message_of

from ispom.evaluation.trajectory_error import error_against_truth
from ispom.io.trajectories import tum_text
from ispom.sequences import open_sequence
from ispom.types import is_video
from tests.app import helpers
from tests.app.gui import text_of
from tests.app.helpers import open_source
from tests.app.viser_ui.conftest import server  # noqa: F401  (a fixture)


def write_tum(folder: Path) -> Path:
    """The video of sim:tiny, with the true poses of its camera."""
    tiny = open_sequence("sim:tiny")
    assert tiny.truth is not None and tiny.rig.video is not None
    (folder / "rgb").mkdir(parents=True)
    rows = []
    for i, kind in enumerate(tiny.kinds):
        if kind == "video":
            frame = tiny[i]
            assert is_video(frame)
            name = f"rgb/{frame.time_ns / 1e9:.6f}.png"
            cv2.imwrite(str(folder / name), frame.image if frame.image.ndim == 2 else frame.image[..., ::-1])
            rows.append(f"{frame.time_ns / 1e9:.6f} {name}\n")
    (folder / "rgb.txt").write_text("".join(rows))
    (folder / "groundtruth.txt").write_text(tum_text(tiny.truth.moved(right=tiny.rig.rig_from_video)))
    c = tiny.rig.video
    distortion = ", ".join(map(repr, map(float, c.distortion)))
    (folder / "camera.yaml").write_text(
        f"model: opencv\nwidth: {c.width}\nheight: {c.height}\nfx: {c.fx}\nfy: {c.fy}\ncx: {c.cx}\ncy: {c.cy}\n"
        f"distortion: [{distortion or '0, 0, 0, 0'}]\n"
    )
    return folder


@pytest.fixture(scope="module")
def single(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    """Such a recording in a session, run to its end."""
    folder = write_tum(tmp_path_factory.mktemp("tum") / "walk")
    session = Session(
        SessionSetup(open_source, str(folder), tmp_path_factory.mktemp("recordings"), methods=("monocular",))
    )
    session.start()
    session.post(do.Speed(None))
    helpers.wait_for(lambda: session.state.ended, "the end", 300)
    assert session.run is not None
    poses = len(session.run.trajectories()["monocular"])
    errors = lambda: session.state[Branches].all[0].measured.errors  # noqa: E731
    helpers.wait_for(lambda: errors() and len(errors()["monocular"].estimate) == poses, "its error", 30)
    yield session
    session.close(5.0)


def test_its_error_is_the_ate_after_a_similarity_alignment(single: Session, server) -> None:  # noqa: F811
    run = single.run
    assert run is not None and run.opened.truth is not None
    error = single.state[Branches].all[0].measured.errors["monocular"]
    found = run.finish().trajectories["monocular"]
    wanted = error_against_truth(found, run.opened.truth, run.opened.sequence.rig, "sim3")
    assert error.alignment == "sim3" and wanted is not None and error.ate_m == wanted.ate_m < 0.02
    (chip,) = message_of(single.state)["methods"]
    assert chip["error"].endswith(" mm") and "Sim(3)" in chip["hint"]
    assert f"{chip['error']} Sim(3)" in text_of(BranchesPanel, server, single)


def test_it_has_an_error_curve_and_no_live_one(single: Session) -> None:
    ((curve, drawn),) = error_curves(single.state)
    error = single.state[Branches].all[0].measured.errors["monocular"]
    assert curve.label == "Monocular (Sim(3))" and np.array_equal(drawn.metres, error.position_errors_m)
    assert single.run is not None
    live = single.run.series.values("monocular.error_m", 0, len(single.run.history))
    assert not np.isfinite(live).any(), "its live poses have no unit"


def test_it_is_aligned_again_a_few_times_only(single: Session) -> None:
    run = single.run
    assert run is not None
    path, seen = TruePath(run.opened), []
    for index in range(len(run.history)):
        found = path.at(run.known_at(index), run.history[index].placements)
        if found is not None and (not seen or found is not seen[-1]):
            seen.append(found)
    assert len(run.history) > FIRST and 3 < len(seen) < 15


def test_the_truth_changes_nothing_that_is_estimated(single: Session, tmp_path: Path) -> None:
    run = single.run
    assert run is not None
    before = run.finish().trajectories["monocular"]
    blind = Session(
        SessionSetup(
            lambda source, options=None: replace(open_source(source, options), truth=None),
            single.state.source,
            tmp_path,
            methods=("monocular",),
        )
    )
    blind.start()
    blind.post(do.Speed(None))
    helpers.wait_for(lambda: blind.state.ended, "the end", 300)
    assert blind.run is not None
    after = blind.run.finish().trajectories["monocular"]
    blind.close(5.0)
    assert np.array_equal(before.translations, after.translations)
    assert np.array_equal(before.rotations, after.rotations)
