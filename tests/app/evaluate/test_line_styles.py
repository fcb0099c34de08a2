"""Colours of an evaluation's plots: a method's where a file is called so, and no two estimates alike."""

from __future__ import annotations

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from ispom_app.features.evaluation.plots import OTHERS, line_styles
from ispom_app.presentation import colours

NAMES = [*colours.METHOD, "orbslam", "vins", "truth-like"]


def test_stereo_has_its_own_colour_wherever_it_stands() -> None:
    for order in (["stereo", "monocular"], ["monocular", "stereo"], ["orbslam", "stereo"]):
        style = line_styles([Path(f"run/{name}.tum") for name in order])[order.index("stereo")]
        assert style.colour == colours.css(colours.of("stereo")) and style.dash == "solid"


def test_the_other_colours_are_no_methods() -> None:
    assert not {*OTHERS} & {*colours.METHOD.values(), colours.TRUTH} and len({*OTHERS}) == len(OTHERS)


@given(st.lists(st.sampled_from(NAMES), max_size=30))
def test_no_two_lines_look_the_same(names: list[str]) -> None:
    styles = line_styles([Path(f"{i}/{name}.tum") for i, name in enumerate(names)])
    assert len({str(style) for style in styles}) == len(names)
