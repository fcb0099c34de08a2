"""A fork with nothing changed writes what its parent wrote, at each kind of frame, for every method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main

from ispom.methods import method as registered
from ispom.methods import with_dependencies
from ispom.types import Frame, Measurement, Trajectory, is_video
from tests.alone import METHODS, PAPER
from tests.app.forked import differing, files_in, files_of, fork_by_command, fork_in, played, rows, worth_forking
from tests.rounds import FRAME_NS, SCENARIOS, Scenario, world_from_rig
from tests.sequences.own_folders import write_sequence

EXPOSURES = 55
DARK = range(20, 29)
"""Video frames without light: every method is lost there."""


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three small cameras on a round trip, with a dark stretch."""
    scenario: Scenario = next(s for s in SCENARIOS if len(s.kinds) == 2)
    bright = scenario.sequence(EXPOSURES)

    def load(i: int) -> Measurement:
        found = bright[i]
        if found.time_ns // FRAME_NS not in DARK:
            return found
        if is_video(found):
            return found.with_images(video=np.zeros_like(found.image))
        return Frame.stereo(found.time_ns, np.zeros_like(found.left), np.zeros_like(found.right))

    times = np.unique(bright.times_ns).tolist()
    truth = Trajectory.of([(t, world_from_rig(t // FRAME_NS)) for t in times])
    return write_sequence(tmp_path_factory.mktemp("flight"), replace(bright, load=load, truth=truth))


@pytest.fixture(scope="module")
def parent(flight: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[list[str], Path]]:
    """The arguments of a method's run, and its folder."""

    def run(method: str) -> tuple[list[str], Path]:
        methods_run, out = with_dependencies((method,)), tmp_path_factory.mktemp(method) / "run"
        few = [f"--{name}.max-tracks=80" for name in methods_run if hasattr(registered(name).config(), "max_tracks")]
        arguments = [str(flight), "--methods", *methods_run, *few]
        assert main(["run", *arguments, "--out", str(out), "--no-recording"]) == 0
        return arguments, out

    return run


@pytest.mark.parametrize("method", [*METHODS, *PAPER])
def test_with_nothing_changed_all_files_are_the_parents(
    method: str, parent: Callable[[str], tuple[list[str], Path]], tmp_path: Path
) -> None:
    (arguments, run), methods_run = parent(method), with_dependencies((method,))
    expected, places = files_in(run, methods_run), worth_forking(run, method)
    assert len(places) >= 5 and any(row["status"] == "lost" for row in rows(run) if row["method"] == method)
    with played(arguments, methods_run, tmp_path / "session") as session:
        assert session.run is not None
        assert not differing(files_of(session.run, methods_run, tmp_path / "page"), expected)
        for at in places:
            assert not differing(files_of(fork_in(session, at), methods_run, tmp_path / f"page-{at}"), expected), at
        for at in (places[0], places[len(places) // 2], places[-1]):
            assert not differing(files_in(fork_by_command(run, at, tmp_path / f"fork-{at}"), methods_run), expected), at


def test_another_setting_is_seen_in_the_files(parent: Callable[[str], tuple[list[str], Path]], tmp_path: Path) -> None:
    _, run = parent("stereo.paper")
    options = ["--at", "20", "--stereo.paper.max-points", "100", "--out", str(tmp_path / "fork"), "--no-recording"]
    assert main(["fork", str(run), *options]) == 0
    found, expected = (files_in(folder, ("stereo.paper",)) for folder in (tmp_path / "fork", run))
    assert set(differing(found, expected)) == set(expected)
    assert [row for row in found["steps.csv"] if int(row["exposure"]) < 20] == [  # type: ignore[arg-type]
        row
        for row in expected["steps.csv"]
        if int(row["exposure"]) < 20  # type: ignore[arg-type]
    ]
