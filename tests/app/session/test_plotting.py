"""The quantity that is drawn over time is part of the state: asked for again it is closed."""

from __future__ import annotations

from pathlib import Path

from ispom_app.session import commands as do

from tests.app.helpers import started, wait_for


def test_a_plot_is_opened_and_closed_by_the_same_command(tmp_path: Path) -> None:
    session = started(tmp_path, autoplay=False)
    session.post(do.Plot("monocular.parallax"))
    wait_for(lambda: session.state.plotted == "monocular.parallax", "the plot")
    session.post(do.Seek(3))
    wait_for(lambda: session.state.index == 3, "the seek")
    assert session.state.plotted == "monocular.parallax"
    session.post(do.Plot("monocular.inliers"))
    wait_for(lambda: session.state.plotted == "monocular.inliers", "another")
    session.post(do.Plot("monocular.inliers"))
    wait_for(lambda: session.state.plotted == "", "none")
    session.close(5)


def test_what_cannot_be_plotted_is_said_and_changes_nothing(tmp_path: Path) -> None:
    session = started(tmp_path, autoplay=False)
    session.post(do.Plot("monocular.inliers"))
    wait_for(lambda: session.state.plotted, "the plot")
    for count, name in enumerate(("monocular.status", "nonsense"), 1):
        session.post(do.Plot(name))
        wait_for(lambda count=count: session.state.notice_count == count, "the notice")
        assert "is nothing that this run could plot" in session.state.notices[-1].text
    assert session.state.plotted == "monocular.inliers"
    session.post(do.Plot(""))
    wait_for(lambda: session.state.plotted == "", "none")
    session.close(5)
