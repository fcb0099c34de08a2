"""No method has become worse on any recording than `figures.json` says, but for a band."""

from __future__ import annotations

import warnings
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from rich.console import Console

from tests.accuracy import studies
from tests.accuracy.figures import (
    FILE,
    SIMULATIONS,
    Figures,
    measure,
    methods_for,
    opened,
    read_figures,
    recordings,
    write_figures,
)

DATA = Path("../shared/data")
BAND = 0.3
"""Estimators are deterministic on one machine. On another processor rounding differs, and with it a choice of a
keyframe or a sample here and there; a change of the code does the same without being better or worse."""
FLOOR_PERCENT, FLOOR = 0.005, 1e-4
"""Errors may grow by as much in any case, in percent of the path and in its unit (0.1 mm). The percentage is the
standard deviation of stereo's error on sim:tiny over seeds 0 to 3 (0.004 to 0.015 %), from the noise alone."""
FLOOR_LOCATED = 0.02
"""Share of the frames."""
STILL = frozenset({"hard/bear_zoom", "hard/rollercoaster_pan", "hard/box_handheld", "hard/teddy_portrait"})
"""The camera only zooms, only rotates, or stands still before a moving object: every map is false, and the fewer frames
are located the better."""
DEFAULT_CPU_S = 5.0
"""Most seconds that the entries of the default run take together. They are the cheapest ones; the others are slow."""
ENTRIES = {(name, method): figures for name, by in read_figures().items() for method, figures in by.items()}
EXACT = Figures(100, 90, 2, 1.0, "se3", 50.0, 0.5, 1.0)


def slow_entries() -> set[tuple[str, str]]:
    """The entries that are not part of the default run."""
    total, slow = 0.0, set()
    for key in sorted(ENTRIES, key=lambda key: ENTRIES[key].seconds):
        total += ENTRIES[key].seconds
        if total > DEFAULT_CPU_S:
            slow.add(key)
    return slow


def largest_error(recorded: Figures) -> float | None:
    """The largest error within the band; None if there is none to compare."""
    if recorded.error is None or recorded.path is None:
        return None
    floor = max(FLOOR, FLOOR_PERCENT / 100 * recorded.path)
    return recorded.error + max(BAND * recorded.error, floor)


def band_located(recorded: Figures) -> float:
    """Share of the frames by which fewer or more may be located: of those located or not, whichever are fewer, and at
    least one frame."""
    share = recorded.share_located
    return max(FLOOR_LOCATED + BAND * min(share, 1 - share), 1 / recorded.frames)


def located_gain(recorded: Figures, now: Figures, still: bool) -> float:
    """The change of the share located, in bands; negative if it is worse."""
    gain = (now.share_located - recorded.share_located) / band_located(recorded)
    return round(-gain if still else gain, 6)


def faults(recorded: Figures, now: Figures, still: bool = False) -> list[str]:
    """What is worse than its band allows; `still` where every map is false."""
    found, limit, error = [], largest_error(recorded), _comparable_error(recorded, now)
    if now.frames != recorded.frames:
        found.append(f"{now.frames} frames are used, {recorded.frames} recorded")
    if limit is not None and (error is None or not error <= limit):
        found.append(f"error {error}, recorded {recorded.error}, limit {limit:.4g}")
    if located_gain(recorded, now, still) < -1:
        band = band_located(recorded) * recorded.frames
        found.append(f"{now.located} frames located, recorded {recorded.located}, band {band:.1f}")
    if now.segments > (most := (1 + BAND) * recorded.segments + 1):
        found.append(f"{now.segments} segments, recorded {recorded.segments}, limit {most:.1f}")
    return found


def gains(recorded: Figures, now: Figures, still: bool = False) -> list[str]:
    """What is better than its band."""
    found, limit, error = [], largest_error(recorded), _comparable_error(recorded, now)
    if limit is not None and recorded.error is not None and error is not None and error < 2 * recorded.error - limit:
        found.append(f"error {error}, recorded {recorded.error}")
    if located_gain(recorded, now, still) > 1:
        found.append(f"{now.located} frames located, recorded {recorded.located}")
    if 0 < now.segments < (recorded.segments - 1) / (1 + BAND):
        found.append(f"{now.segments} segments, recorded {recorded.segments}")
    return found


def _comparable_error(recorded: Figures, now: Figures) -> float | None:
    """Over all poses if nothing but one segment is recorded: an error must not shrink because a method starts again."""
    return now.ate if recorded.segment_ate is None else now.error


@pytest.mark.timeout(3600)
@pytest.mark.parametrize(
    ("name", "method"),
    [pytest.param(*key, marks=[pytest.mark.slow] * (key in slow_entries()), id=" ".join(key)) for key in ENTRIES],
)
def test_no_figure_is_worse_than_its_band(name: str, method: str) -> None:
    source = recordings(DATA).get(name)
    if source is None:
        pytest.skip(f"{name} is not in {DATA}")
    recorded, now = ENTRIES[name, method], measure(name, source, method)
    if better := gains(recorded, now, name in STILL):
        warnings.warn(
            f"better than recorded, run python -m tests.accuracy figures --only '{name}': {better}", stacklevel=1
        )
    assert not faults(recorded, now, name in STILL), f"{now}"


@pytest.mark.parametrize("name", recordings(DATA))
def test_every_method_has_figures_of_every_recording(name: str) -> None:
    """New recordings and methods are noticed: measure them by `python -m tests.accuracy figures --only NAME`."""
    methods = methods_for(name, opened(name, recordings(DATA)[name]))
    assert [m for m in methods if (name, m) not in ENTRIES] == []


def test_simulations_are_recordings_where_there_are_no_data(tmp_path: Path) -> None:
    assert list(recordings(tmp_path / "none")) == list(SIMULATIONS)


def test_a_new_folder_of_images_is_a_recording(tmp_path: Path) -> None:
    for folder in ("hard/new", "reports/old"):
        (tmp_path / folder).mkdir(parents=True)
        for i in range(3):
            (tmp_path / folder / f"{i:06d}.png").write_bytes(b"")
    assert list(recordings(tmp_path)) == [*SIMULATIONS, "hard/new"]


def test_the_file_is_as_the_command_writes_it(tmp_path: Path) -> None:
    write_figures(read_figures(), tmp_path / "figures.json")
    assert (tmp_path / "figures.json").read_text() == FILE.read_text()


def test_the_command_keeps_entries_that_it_does_not_measure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, failing = tmp_path / "figures.json", {"error": "failed, please report it"}
    write_figures({"sim:tiny": {"stereo": EXACT, "monocular": EXACT}, "gone": {"stereo": EXACT}}, file)
    better = replace(EXACT, ate=0.1)
    monkeypatch.setattr(
        studies, "found", lambda module, task: asdict(better) if task["method"] == "stereo" else failing
    )
    options = studies.Options(tmp_path, ("stereo", "monocular"), only=("sim:tiny", "hard/unknown"), file=file)
    rows = studies.figures(console := Console(record=True), options)
    assert [(row["method"], row["ate"]) for row in rows] == [("stereo", 0.1)]
    assert read_figures(file) == {"sim:tiny": {"stereo": better, "monocular": EXACT}, "gone": {"stereo": EXACT}}
    printed = console.export_text()
    assert "hard/unknown: skipped" in printed and failing["error"] in printed


def test_default_run_is_short() -> None:
    assert 0 < sum(ENTRIES[key].seconds for key in set(ENTRIES) - slow_entries()) <= DEFAULT_CPU_S


@pytest.mark.parametrize(
    ("changes", "failing"),
    [
        ({}, False),
        ({"ate": 0.649, "located": 85, "segments": 3}, False),
        ({"ate": 0.651}, True),
        ({"ate": None}, True),
        ({"ate": float("nan")}, True),
        ({"ate": 0.9, "segment_ate": 0.1, "segments": 3}, True),
        ({"located": 84}, True),
        ({"segments": 4}, True),
        ({"frames": 99}, True),
    ],
)
def test_what_is_worse_than_the_band_fails(changes: dict, failing: bool) -> None:
    assert bool(faults(EXACT, replace(EXACT, **changes))) is failing
    assert gains(EXACT, EXACT) == []


def test_small_errors_have_a_floor() -> None:
    still = replace(EXACT, path=0.003, ate=0.0001)
    assert faults(still, replace(still, ate=0.00019)) == [] != faults(still, replace(still, ate=0.00021))
    exact = replace(EXACT, path=100.0, ate=0.001)
    assert faults(exact, replace(exact, ate=0.0059)) == [] != faults(exact, replace(exact, ate=0.0061))


def test_separate_segments_are_compared_one_by_one() -> None:
    parts = replace(EXACT, ate=5.0, segment_ate=0.5)
    assert faults(parts, replace(parts, ate=9.0, segment_ate=0.6)) == []
    assert faults(parts, replace(parts, ate=0.1, segment_ate=0.7)) != []
    assert gains(parts, replace(parts, ate=0.1, segment_ate=None, segments=1)) != []


def test_few_located_frames_must_stay_located_and_one_frame_is_no_fault() -> None:
    few = replace(EXACT, located=10)
    assert faults(few, replace(few, located=5)) == [] != faults(few, replace(few, located=4))
    short = replace(EXACT, frames=17, located=17)
    assert faults(short, replace(short, located=16)) == [] != faults(short, replace(short, located=15))


def test_a_false_map_is_worse_than_none() -> None:
    none = Figures(100, 0, 0, 1.0)
    assert faults(none, replace(none, located=2, segments=1), still=True) == []
    assert faults(none, replace(none, located=3, segments=1), still=True) != []
    assert faults(none, replace(none, located=50, segments=1)) == []
    assert gains(EXACT, replace(EXACT, located=50), still=True) != []


def test_what_is_better_is_reported() -> None:
    assert len(gains(EXACT, replace(EXACT, ate=0.3, located=99, segments=1))) == 2
    assert len(gains(replace(EXACT, segments=5), replace(EXACT, segments=2))) == 1
