"""ISPOM: position and orientation of a moving platform from its images (Li, Liu and Yuan 2013), as a library.

What a plug-in or a notebook needs is importable from here. A stable name is removed only after one release in which
using it warns; docs/stability.md lists the experimental ones. Everything below (`ispom.solvers`, ...) may change with
each release.

    import ispom
    run = ispom.run("sim:tiny", "stereo")         # a path, a sequence, or images with a rig
    run.trajectory, run.steps[3].inliers, run.covariances
    run.show(frame=34)                            # in a cell; what is chosen there is view.frame, view.tracks
    run.evaluate().ate                            # with the numbers of `ispom evaluate`
    run.save("runs/tiny")                         # as `ispom run` does: for the page, reports, ispom.read_run
    for step in ispom.stepper("sim:tiny", "stereo"):
        ...                                       # stop, go back, fork

Several methods over one sequence are an `Ensemble`: `ispom.build(ispom.Config(), methods, sequence.rig)`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ispom.cameras import CameraModel
    from ispom.ensemble import Ensemble, build
    from ispom.errors import InputError, UnreadableImage
    from ispom.estimator import Estimator, Integrator, Method, MethodConfig, require_frame
    from ispom.evaluation.metrics import path_errors
    from ispom.evaluation.trajectory_error import aligned, ate_m
    from ispom.features.descriptors import (
        DescriptorTracker,
        OpenCvFeatures,
        SimilarityMatcher,
        descriptor_front_end,
        dot_product,
        hamming_similarity,
        match_near,
    )
    from ispom.features.front_ends import front_end, front_ends
    from ispom.features.interfaces import Descriptor, Detector, Features, FrontEnd, Matcher, Tracker
    from ispom.features.klt import Klt
    from ispom.features.shi_tomasi import detect_corners, detect_spread
    from ispom.geometry import Pose, Similarity, skew
    from ispom.methods import Config, default_methods, method, possible_methods
    from ispom.notebook.folders import StoredRun, StoredStep, read_run
    from ispom.notebook.register import register
    from ispom.notebook.result import Evaluation
    from ispom.notebook.run import Run, run
    from ispom.notebook.stepper import Stepper, stepper
    from ispom.persistent_list import PersistentList
    from ispom.sensors.fusion import POSE, Factor, GraphFrames, Node, NodeContext, Offset
    from ispom.sensors.kind import FileOptions, Readings, SensorKind, Table
    from ispom.sensors.simulated import Scenery, SensorFaults
    from ispom.sequences import open_sequence
    from ispom.sequences.format import Format
    from ispom.sequences.recording import Recording
    from ispom.settings import Range
    from ispom.solvers.localisation import resect
    from ispom.solvers.multiview.essential import relative_pose
    from ispom.solvers.trajectory.alignment import umeyama
    from ispom.testing import check_camera_model, check_estimator
    from ispom.types import (
        Camera,
        CameraSensor,
        Check,
        Corrections,
        Decision,
        Frame,
        GnssAntenna,
        GnssFix,
        ImageLines,
        Imu,
        ImuSamples,
        Landmarks,
        LaserScan,
        LaserScanner,
        LensCorrection,
        LensSigma,
        Measurement,
        MountCorrection,
        PairCorrection,
        PairSigma,
        Rig,
        Sensor,
        Sequence,
        Status,
        Step,
        TimedPoints,
        Tracks,
        TrackStatus,
        Trajectory,
        WheelIncrement,
        WheelOdometer,
        WorldLines,
        as_grey,
    )

_HOMES = {
    "ispom.cameras": "CameraModel",
    "ispom.ensemble": "Ensemble build",
    "ispom.errors": "InputError UnreadableImage",
    "ispom.estimator": "Estimator Integrator Method MethodConfig require_frame",
    "ispom.evaluation.trajectory_error": "aligned ate_m",
    "ispom.evaluation.metrics": "path_errors",
    "ispom.features.descriptors": "DescriptorTracker OpenCvFeatures SimilarityMatcher descriptor_front_end dot_product "
    "hamming_similarity match_near",
    "ispom.features.front_ends": "front_end front_ends",
    "ispom.features.interfaces": "Descriptor Detector Features FrontEnd Matcher Tracker",
    "ispom.features.klt": "Klt",
    "ispom.features.shi_tomasi": "detect_corners detect_spread",
    "ispom.geometry": "Pose Similarity skew",
    "ispom.methods": "Config default_methods method possible_methods",
    "ispom.notebook.register": "register",
    "ispom.notebook.folders": "StoredRun StoredStep read_run",
    "ispom.notebook.result": "Evaluation",
    "ispom.notebook.run": "Run run",
    "ispom.notebook.stepper": "Stepper stepper",
    "ispom.persistent_list": "PersistentList",
    "ispom.sensors.fusion": "POSE Factor GraphFrames Node NodeContext Offset",
    "ispom.sensors.kind": "FileOptions Readings SensorKind Table",
    "ispom.sensors.simulated": "Scenery SensorFaults",
    "ispom.sequences": "open_sequence",
    "ispom.sequences.format": "Format",
    "ispom.sequences.recording": "Recording",
    "ispom.settings": "Range",
    "ispom.solvers.multiview.essential": "relative_pose",
    "ispom.solvers.localisation": "resect",
    "ispom.solvers.trajectory.alignment": "umeyama",
    "ispom.testing": "check_camera_model check_estimator",
    "ispom.types": "Camera CameraSensor Check Corrections Decision Frame GnssAntenna GnssFix ImageLines Imu ImuSamples "
    "Landmarks LaserScan LaserScanner LensCorrection LensSigma Measurement MountCorrection PairCorrection "
    "PairSigma Rig Sensor Sequence Status Step TimedPoints TrackStatus Tracks Trajectory WheelIncrement "
    "WheelOdometer WorldLines as_grey",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}
__all__ = sorted(_HOME_OF)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """A public name, whose module is imported when it is first used: `import ispom` alone takes no time."""
    if name not in _HOME_OF:
        raise AttributeError(f"module 'ispom' has no attribute {name!r}")
    value = getattr(import_module(_HOME_OF[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
