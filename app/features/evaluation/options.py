"""Options of `ispom evaluate`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import tyro

from ispom.evaluation.audit.correction import Convention
from ispom.evaluation.trajectory_error import Alignment

from ...engine.options import ReadsRuns


@dataclass(frozen=True, kw_only=True)
class Evaluate(ReadsRuns):
    """Compares trajectories with a reference: ATE, RPE, KITTI's errors, scale and coverage, with their protocol."""

    READS: ClassVar[tuple[str, ...]] = ("reference", "estimates")
    reference: tyro.conf.Positional[Path]
    """Reference trajectory: a file of poses of any known program (TUM, KITTI, EuRoC, COLMAP, nerfstudio, OpenVINS,
    g2o, tables with a header, JSON, bags as BAG:TOPIC ...), recognised by its content."""
    estimates: tyro.conf.Positional[tuple[Path, ...]]
    """Trajectories to compare with it."""
    alignment: Alignment = "se3"
    """How an estimate is aligned with the reference. none; first: at the first pose; scale: scale only; se3: rotation
    and translation; sim3: those and scale (needed where the estimate's unit is not the metre)."""
    max_difference_s: float = 0.01
    """Largest time difference of associated poses [s]."""
    times: Path | None = None
    """Times of the rows of files without times, such as KITTI's and COLMAP's [s], as KITTI's times.txt."""
    delta: str = "1"
    """Distance of the two poses of a relative error (RPE): a number of poses, such as 10, a length of the reference's
    path, such as 1m, or a time, such as 1s. Only lengths and times compare a keyframe trajectory with a full one."""
    align_first: int | None = None
    """Fit the alignment to this number of first compared poses only, so that later errors are drift; by default to
    all."""
    positions_only: bool = False
    """Compare positions only: no errors of rotations, and none in the body."""
    audit: bool = True
    """Whether to look for a wrong question behind the errors: the clock, axes, inverse poses, another body, the unit
    and more. Nothing is corrected unless an option below asks for it."""
    offset: float = 0.0
    """Added to the estimates' times [s]; for files without times, to the numbers of their rows."""
    clock_rate: float = 1.0
    """Seconds of the reference per second of the estimates, about their first poses: 1.00002 for a clock that is slow,
    0.001 for milliseconds."""
    conventions: tuple[Convention, ...] = ()
    """What the estimates' poses are, if not right-handed world_from_body. inverse: body_from_world. rotations-inverse:
    only the rotations are inverse. w-first: quaternions have w first, but were read with w last; w-last: the reverse.
    mirrored-x, -y, -z: left-handed, by this axis."""
    reference_conventions: tuple[Convention, ...] = ()
    """The same of the reference."""
    body: Literal["same", "auto"] = "same"
    """auto: fit the constant pose between the estimate's body and the reference's, as far as the audit finds one, and
    apply it to the estimate."""
    exclude: tuple[str, ...] = ()
    """Stretches of the reference's clock that are not compared, as FROM:TO [s], ends included; one may be missing."""
    json: Path | None = None
    """Write all numbers and the protocol as JSON to this file."""
    csv: Path | None = None
    """Write a line per estimate to this file."""
    latex: Path | None = None
    """Write a table for LaTeX (with booktabs) to this file: a row per estimate, with its coverage beside its errors."""
    plots: Path | None = None
    """Write plots of trajectories, errors and scale to this folder."""
    colour_by: str | None = None
    """Plot the paths coloured by position-error, rotation-error, scale or speed, or, where an estimate is a method's
    file in a run, by a number of its steps.csv or one of its checks, such as inliers or residual_px."""
    runs: bool = False
    """The estimates are runs of one method: the plot of errors shows them as a band, from the least to the largest,
    with the median."""
    plot_format: Literal["png", "svg"] = "png"
    """Format of the plots."""

    def _read(self) -> tuple[Path, ...]:
        """Folders of the files that are missing: a run that was killed has no trajectories yet."""
        return tuple(dict.fromkeys(path.parent for path in super()._read() if not path.is_file()))
