"""The values that flow between sequences, estimators and viewers. All frozen; arrays are never written to."""

from ispom.types.calibration import EXACT_LENS, EXACT_PAIR, LensSigma, PairSigma
from ispom.types.camera import Camera, Frame, Image, Rig
from ispom.types.check import Check, by_key
from ispom.types.exposure import Exposure, Kind, StereoPair, VideoFrame, as_grey, colours_at
from ispom.types.guess import Guess
from ispom.types.integration import SegmentFit, SplineFit
from ispom.types.sequence import Sequence
from ispom.types.step import Decision, DecisionKind, Status, Step
from ispom.types.timed_points import TimedPoints
from ispom.types.tracks import Landmarks, Tracks, TrackStatus
from ispom.types.trajectory import Trajectory

__all__ = [
    "EXACT_LENS",
    "EXACT_PAIR",
    "Camera",
    "Check",
    "Decision",
    "DecisionKind",
    "Exposure",
    "Frame",
    "Guess",
    "Image",
    "Kind",
    "Landmarks",
    "LensSigma",
    "PairSigma",
    "Rig",
    "SegmentFit",
    "Sequence",
    "SplineFit",
    "Status",
    "Step",
    "StereoPair",
    "TimedPoints",
    "TrackStatus",
    "Tracks",
    "Trajectory",
    "VideoFrame",
    "as_grey",
    "by_key",
    "colours_at",
]
