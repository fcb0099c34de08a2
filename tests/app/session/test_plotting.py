"""The quantities that are plotted are part of the state: the same command adds one and removes it."""

from __future__ import annotations

from pathlib import Path

from ispom_app.features.plots.commands import DEFAULT_PLOTS, MOST_PLOTS, Plot, Plots, SetPlots
from ispom_app.session import commands as do

from tests.app.helpers import started, wait_for


def test_a_plot_is_added_and_removed_by_the_same_command(tmp_path: Path) -> None:
    session = started(tmp_path, autoplay=False)
    session.post(Plot("monocular.parallax"))
    wait_for(lambda: session.state[Plots].names == (*DEFAULT_PLOTS, "monocular.parallax"), "the plot")
    session.post(do.Seek(3))
    wait_for(lambda: session.state.index == 3, "the seek")
    session.post(Plot("inliers"))
    wait_for(lambda: session.state[Plots].names == ("error", "monocular.parallax"), "one less")
    session.close(5)


def test_what_cannot_be_plotted_is_reported_and_changes_nothing(tmp_path: Path) -> None:
    session = started(tmp_path, autoplay=False)
    for count, name in enumerate(("monocular.status", "nonsense", "time_s"), 1):
        session.post(Plot(name))
        wait_for(lambda count=count: session.state.notice_count == count, "the notice")
    assert session.state[Plots].names == DEFAULT_PLOTS
    session.close(5)


def test_an_address_sets_them_all_at_once_and_what_the_run_does_not_have_is_ignored(tmp_path: Path) -> None:
    session = started(tmp_path, autoplay=False)
    session.post(SetPlots(("stereo.inliers", "nonsense", "stereo.inliers")))
    wait_for(lambda: session.state[Plots].names == ("stereo.inliers",), "the plots")
    session.post(SetPlots(()))
    wait_for(lambda: session.state[Plots].names == (), "none")
    session.post(SetPlots(None))
    wait_for(lambda: session.state[Plots].names == DEFAULT_PLOTS, "the usual ones")
    session.post(SetPlots(tuple(list(session.series.quantities)[8 : 8 + 2 * MOST_PLOTS])))
    wait_for(lambda: len(session.state[Plots].names) == MOST_PLOTS, "as many as there may be")
    session.close(5)
