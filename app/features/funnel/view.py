"""What becomes of the features of an image: detected, tracked, with depth, inliers; and which of these stages limits
the number of inliers, with the setting or the check behind it.

No count is invented. How many corners a detection found beyond those that it was allowed is not known, so the first
stage is the number of tracks after the last detection; a run that is read from its folder has no depths.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import msgspec
import numpy as np

from ispom.methods import Config
from ispom.methods import method as registered
from ispom.types import Status, Step, TrackStatus

from ...engine.frame_record import INLIERS
from ...engine.history.step_quantities.step import DROPPED
from ...presentation import colours
from ...presentation.decisions import sentence
from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.web.view_values import View

CAP = "max_tracks"
"""The setting that says how many tracks there may be."""
REACHED = 0.95
"""Share of that number from which on it is the limit: a detection keeps distances between corners."""
MOST = 2 / 3
"""A stage that keeps a smaller share than this limits the inliers; where none does, the first stage does."""
NOT_TRACKED = (
    TrackStatus.LOST,
    TrackStatus.FORWARD_BACKWARD,
    TrackStatus.OUT_OF_IMAGE,
    TrackStatus.UNMATCHED,
)
"""What became of features that were not tracked into the image; the others were tracked and rejected later."""


class FunnelStage(msgspec.Struct, frozen=True):
    name: str
    count: int
    limits: bool
    """Whether this stage limits the inliers most."""
    why: str
    """The setting or the check behind it, in a few words."""


class MethodFunnel(msgspec.Struct, frozen=True):
    label: str
    colour: str
    frame: int
    """Of its step, which may be before the frame shown."""
    stages: tuple[FunnelStage, ...]


class FunnelView(msgspec.Struct, frozen=True):
    """Of the methods that track features; none of others."""

    methods: tuple[MethodFunnel, ...]


def funnel(state: State, run: CurrentRun | None, frame: int) -> FunnelView:
    """The stages of each method at its newest frame up to the one shown, so that rows do not come and go."""
    shown = state.displayed
    if run is None or shown is None:
        return FunnelView(())
    found = []
    for method in state.methods:
        at = run.series.last_step(method, frame)
        if at is None:
            continue
        record = shown if at == frame else run.history[at]
        found += [_method(step, run, at) for step in record.steps if step.method == method]
    return FunnelView(tuple(each for each in found if each.stages))


def _method(step: Step, run: CurrentRun, frame: int) -> MethodFunnel:
    stages = _stages(step, _numbers(run, step.method, frame), _detected(run, step.method, frame), run, frame)
    return MethodFunnel(colours.label(step.method), colours.css(colours.of(step.method)), frame, stages)


def _config(run: CurrentRun, frame: int) -> Config:
    """The settings at a frame: before a fork, those of the run that it came from."""
    playback = run.playback
    return next((stage.config for stage in playback.earlier if frame < stage.until), playback.config)


def _detected(run: CurrentRun, method: str, frame: int) -> int | None:
    """The number of tracks after the last detection before the frame; None where there was none."""
    names = f"{method}.alive", f"{method}.new"
    if any(name not in run.series.quantities for name in names):
        return None
    alive, new = (run.series.values_of(name, max(frame, 0))[1] for name in names)
    at = np.flatnonzero(np.nan_to_num(new) > 0)
    return int(np.nan_to_num(alive[at[-1]]) + new[at[-1]]) if len(at) else None


def _numbers(run: CurrentRun, method: str, frame: int) -> dict[str, int]:
    """By key, the counts of tracks of its step at the frame; without those that it does not have."""
    found, series = {}, run.series
    for key in ("alive", INLIERS.key, *DROPPED):
        quantity = series.quantities.get(f"{method}.{key}")
        value = None if quantity is None or frame >= len(series) else series.value(quantity, frame)
        if isinstance(value, int | float):
            found[key] = int(value)
    return found


def _stages(
    step: Step, here: dict[str, int], detected: int | None, run: CurrentRun, frame: int
) -> tuple[FunnelStage, ...]:
    if detected is None or "alive" not in here:
        return ()
    gone = {status: here.get(key, 0) for key, status in DROPPED.items()}
    tracked = here["alive"] + sum(count for status, count in gone.items() if status not in NOT_TRACKED)
    counts = {"detected": detected, "tracked": tracked}
    if (depth := _with_depth(step)) is not None:
        counts["with depth"] = depth
    counts["inliers"] = here.get(INLIERS.key, 0)
    # Before there is a map, no point has a depth: what limits is before that.
    limiting = _limiting(counts if step.status != Status.INITIALISING else dict(list(counts.items())[:2]))
    reasons = {
        "detected": _cap(step.method, detected, _config(run, frame)),
        "tracked": f"{detected - counts['tracked']} ended since the last detection",
        "with depth": f"{counts['tracked'] - counts.get('with depth', 0)} have no 3-D point yet",
        "inliers": next(_pose_checks(step), ""),
    }
    return tuple(FunnelStage(name, count, name == limiting, reasons[name]) for name, count in counts.items())


def _with_depth(step: Step) -> int | None:
    """Tracks whose point is known, so that they took part in the pose; None where the tracks are not kept."""
    residuals = [tracks.residual_px for tracks in step.tracks.values()]
    return sum(int(np.isfinite(each).sum()) for each in residuals) if residuals else None


def _limiting(counts: dict[str, int]) -> str:
    """The stage that keeps the smallest share of the one before it; the first one where all keep most."""
    names = list(counts)
    shares = {now: counts[now] / counts[before] for before, now in pairwise(names) if counts[before]}
    worst = min(shares, key=lambda name: shares[name], default=names[0])
    return worst if shares.get(worst, 1.0) < MOST else names[0]


def _cap(method: str, detected: int, config: Config) -> str:
    allowed = getattr(config.of(method), CAP, None)
    if not allowed:
        return ""
    reached = f"limit: {CAP.replace('_', '-')} {allowed}"
    return reached if detected >= REACHED * allowed else f"{CAP.replace('_', '-')} allows {allowed}"


def _pose_checks(step: Step) -> Iterator[str]:
    checks = registered(step.method).checks
    for decision in step.decisions:
        check = checks.get(decision.key)
        if check is not None and check.topic == "pose":
            yield sentence(decision, check)


VIEWS = (View("funnel", "#funnel", 91, funnel),)
