"""What is computed in advance is what the session would tell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import pytest
from ispom_app.features.layers.state import Layers
from ispom_app.features.plots.commands import DEFAULT_PLOTS, Plots
from ispom_app.features.plots.page_message import PlotNews
from ispom_app.features.publish.messages import finished_state, run_message
from ispom_app.features.publish.review import reviewed
from ispom_app.views.web.messages import message_of

from tests.app.helpers import build_full, ran
from tests.sequences.kitti_folder import make_drive


def test_hidden_layers_add_up(runs: tuple[Path, Path]) -> None:
    with reviewed([runs[0]], ["first"]) as review:
        run, state = review.session.run, finished_state(review.session.state, "first")
        assert run is not None
        found = run_message(state, run)
        for pair in combinations(found["paths"], 2):
            hidden = message_of(state.having(Layers(hidden=frozenset(pair))))["hidden"]
            added = {path for name in pair for path in found["paths"][name]}
            assert set(hidden) == added | set(found["message"]["hidden"]), pair


def test_frames_and_plots_are_those_of_the_session(runs: tuple[Path, Path]) -> None:
    with reviewed([runs[0]], ["first"]) as review:
        run, state = review.session.run, finished_state(review.session.state, "first")
        assert run is not None
        found = run_message(state, run)
        for index in (0, 5, len(run.history) - 1):
            told = message_of(replace(state, displayed=run.history[index]))
            assert all(found["frames"][index][name] == told[name] for name in ("index", "time_s", "methods"))
        for names in (DEFAULT_PLOTS, ("alive", "stereo.inliers")):
            news = PlotNews().since(state.having(Plots(names)), run)
            assert news is not None and news["plots"] == [found["plots"]["rows"][name] for name in names]
            for curve, frames, values in [*news["values"], *news.get("errors", ())]:
                assert found["plots"]["values"][curve] == [frames, values]


def test_runs_on_other_frames_are_refused(
    runs: tuple[Path, Path], publish: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = make_drive(tmp_path / "other", 6)
    (drive / "times.txt").write_text("".join(f"{i / 7:e}\n" for i in range(6)))
    ran(drive, tmp_path / "other_run", "--stereo-every", "2", builder=build_full)
    assert publish(runs[0], tmp_path / "other_run", "--out", tmp_path / "site") == 2
    assert "other frames" in capsys.readouterr().err
