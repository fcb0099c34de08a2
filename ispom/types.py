"""The values that flow between sequences, estimators and viewers. All frozen; arrays are never written to."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum, StrEnum
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ispom.geometry import Array, Pose

Frame = Literal["world", "rig", "left", "right", "video", "board", "body"]
Image = NDArray[np.uint8]
"""(H, W) grey or (H, W, 3) RGB, uint8; pixel (0, 0) is the centre of the top-left pixel."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with OpenCV's distortion model; axes x right, y down, z forward."""

    width: int
    height: int
    fx: float
    """Focal lengths and principal point [px]."""
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    """OpenCV's k1, k2, p1, p2[, k3[, k4, k5, k6]]; empty for none."""

    @property
    def matrix(self) -> Array:
        """K (3, 3)."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    def project(self, xyz_in_camera: Array) -> Array:
        """Pixels (N, 2) of points (N, 3); a point on or behind the image plane gives NaN."""
        xyz = np.asarray(xyz_in_camera, float).reshape(-1, 3)
        z = np.where(xyz[:, 2] > 1e-9, xyz[:, 2], np.nan)
        if not self.distortion:
            return np.stack([self.fx * xyz[:, 0] / z + self.cx, self.fy * xyz[:, 1] / z + self.cy], axis=1)
        out = np.full((len(xyz), 2), np.nan)
        front = ~np.isnan(z)
        if front.any():
            uv, _ = cv2.projectPoints(
                xyz[front], np.zeros(3), np.zeros(3), self.matrix, np.array(self.distortion, float)
            )
            out[front] = uv.reshape(-1, 2)
        return out

    def normalise(self, uv: Array) -> Array:
        """Undistorted coordinates (N, 2) on the plane z = 1 of pixels (N, 2)."""
        uv = np.asarray(uv, float).reshape(-1, 2)
        if not self.distortion or not len(uv):
            return (uv - (self.cx, self.cy)) / (self.fx, self.fy)
        undistorted = cv2.undistortPoints(
            uv[:, None],
            self.matrix,
            np.array(self.distortion, float),
            criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-12),
        )
        return np.asarray(undistorted, float).reshape(-1, 2)

    def scaled(self, factor: float) -> Camera:
        """The camera of the image resized by factor (pixel centres kept in place)."""
        width, height = round(self.width * factor), round(self.height * factor)
        sx, sy = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * sx,
            fy=self.fy * sy,
            cx=(self.cx + 0.5) * sx - 0.5,
            cy=(self.cy + 0.5) * sy - 0.5,
        )


@dataclass(frozen=True, eq=False)
class Rig:
    """The cameras of the platform and where they sit. Stereo images are rectified: one K, rows aligned, undistorted."""

    video: Camera | None = None
    left: Camera | None = None
    right: Camera | None = None
    rig_from_video: Pose = field(default_factory=Pose)
    rig_from_left: Pose = field(default_factory=Pose)
    rig_from_right: Pose = field(default_factory=Pose)

    @property
    def has_stereo(self) -> bool:
        return self.left is not None and self.right is not None

    @property
    def baseline_m(self) -> float:
        """Distance of the right camera from the left one along the left x axis."""
        return float((self.rig_from_left.inverse() @ self.rig_from_right).translation[0])

    def camera(self, name: Frame) -> Camera:
        """The camera called video, left or right; KeyError where the rig has none."""
        found = {"video": self.video, "left": self.left, "right": self.right}[name]
        if found is None:
            raise KeyError(f"this rig has no {name} camera")
        return found

    def rig_from(self, frame: Frame) -> Pose:
        """rig_from_FRAME for rig, video, left or right."""
        return {
            "rig": Pose(),
            "video": self.rig_from_video,
            "left": self.rig_from_left,
            "right": self.rig_from_right,
        }[frame]

    @staticmethod
    def stereo(left: Camera, baseline_m: float) -> Rig:
        """A rectified pair alone: the rig frame is centred on the baseline (Fig. 6), with the left camera's axes."""
        half = np.array([baseline_m / 2, 0, 0])
        return Rig(left=left, right=left, rig_from_left=Pose(translation=-half), rig_from_right=Pose(translation=half))

    @staticmethod
    def single(video: Camera) -> Rig:
        """A video camera alone: it is the rig."""
        return Rig(video=video)


@dataclass(frozen=True, eq=False)
class VideoFrame:
    time_ns: int
    image: Image


@dataclass(frozen=True, eq=False)
class StereoPair:
    time_ns: int
    left: Image
    right: Image


Exposure = VideoFrame | StereoPair
Kind = Literal["video", "stereo"]


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Poses world_from_FRAME over time."""

    times_ns: NDArray[np.int64]
    """(N,) strictly increasing [ns]."""
    rotations: Array
    """(N, 3, 3)."""
    translations: Array
    """(N, 3) [m, or the trajectory's own unit]."""
    frame: Frame = "rig"

    def __post_init__(self) -> None:
        n = len(self.times_ns)
        if self.rotations.shape != (n, 3, 3) or self.translations.shape != (n, 3):
            raise ValueError(f"{n} times with {self.rotations.shape} rotations and {self.translations.shape} positions")

    @staticmethod
    def empty(frame: Frame = "rig") -> Trajectory:
        return Trajectory(np.zeros(0, np.int64), np.zeros((0, 3, 3)), np.zeros((0, 3)), frame)

    @staticmethod
    def of(items: list[tuple[int, Pose]], frame: Frame = "rig") -> Trajectory:
        """From (time_ns, pose) in any order; of two at the same time the later in the list counts."""
        if not items:
            return Trajectory.empty(frame)
        latest = dict(items)
        times = sorted(latest)
        return Trajectory(
            np.array(times, np.int64),
            np.stack([latest[t].rotation for t in times]),
            np.stack([latest[t].translation for t in times]),
            frame,
        )

    def __len__(self) -> int:
        return len(self.times_ns)

    def pose(self, i: int) -> Pose:
        return Pose(self.rotations[i], self.translations[i])

    def items(self) -> list[tuple[int, Pose]]:
        return [(int(t), self.pose(i)) for i, t in enumerate(self.times_ns)]

    def at(self, time_ns: int) -> Pose | None:
        """The pose at exactly this time, or None."""
        i = int(np.searchsorted(self.times_ns, time_ns))
        return self.pose(i) if i < len(self) and self.times_ns[i] == time_ns else None

    def select(self, index: NDArray) -> Trajectory:
        """The poses of a slice, boolean mask or index array."""
        return Trajectory(self.times_ns[index], self.rotations[index], self.translations[index], self.frame)

    @property
    def xyzw(self) -> Array:
        """Quaternions (N, 4), x, y, z, w, w >= 0."""
        if not len(self):
            return np.zeros((0, 4))
        return Rotation.from_matrix(self.rotations).as_quat(canonical=True)

    @property
    def length(self) -> float:
        """Path length, in the unit of the translations."""
        return float(np.linalg.norm(np.diff(self.translations, axis=0), axis=1).sum())

    def moved(self, left: Pose | None = None, right: Pose | None = None, frame: Frame | None = None) -> Trajectory:
        """Every pose P as left @ P @ right: `left` changes the world, `right` (OLD_from_FRAME) the moving frame."""
        left, right = left or Pose(), right or Pose()
        return Trajectory(
            self.times_ns,
            left.rotation @ self.rotations @ right.rotation,
            (self.rotations @ right.translation + self.translations) @ left.rotation.T + left.translation,
            frame or self.frame,
        )


class TrackStatus(IntEnum):
    """What became of a track in this image; from LOST on it ended, and the name says why."""

    ALIVE = 0
    NEW = 1
    LOST = 2
    FORWARD_BACKWARD = 3
    OUT_OF_IMAGE = 4
    EPIPOLAR = 5
    REPROJECTION = 6
    RIGID = 7
    NO_DISPARITY = 8
    UNMATCHED = 9

    @property
    def dropped(self) -> bool:
        return self >= TrackStatus.LOST

    @property
    def reason(self) -> str:
        """One line for people."""
        return {
            0: "alive",
            1: "new",
            2: "not found again",
            3: "forward-backward check failed",
            4: "left the image",
            5: "off the epipolar line",
            6: "reprojection error too large",
            7: "does not fit the rigid motion",
            8: "no reliable left-right match",
            9: "descriptor match not found or ambiguous",
        }[int(self)]


@dataclass(frozen=True, eq=False)
class Tracks:
    """The image points of one camera at one exposure, those that ended in it included."""

    ids: NDArray[np.int64]
    """(N,) unique for the run of one estimator."""
    uv: NDArray[np.float32]
    """(N, 2) [px]; of an ended track the last known place."""
    uv_prev: NDArray[np.float32]
    """(N, 2) [px] in the same camera's previous exposure; NaN where new."""
    status: NDArray[np.uint8]
    """(N,) TrackStatus."""
    residual_px: NDArray[np.float32]
    """(N,) reprojection error of the last pose estimate; NaN where the point took no part."""
    disparity_px: NDArray[np.float32]
    """(N,) left minus right column; NaN where unknown (and in the video camera)."""

    @staticmethod
    def of(ids: NDArray, uv: NDArray, **others: NDArray) -> Tracks:
        """With NaN or ALIVE for what is not given."""
        n = len(ids)
        nan1, nan2 = np.full(n, np.nan, np.float32), np.full((n, 2), np.nan, np.float32)
        return Tracks(
            np.asarray(ids, np.int64),
            np.asarray(uv, np.float32).reshape(n, 2),
            np.asarray(others.get("uv_prev", nan2), np.float32),
            np.asarray(others.get("status", np.zeros(n)), np.uint8),
            np.asarray(others.get("residual_px", nan1), np.float32),
            np.asarray(others.get("disparity_px", nan1), np.float32),
        )

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, eq=False)
class Landmarks:
    """Points of the scene, in the world (and unit) of the trajectory that they belong to."""

    ids: NDArray[np.int64]
    """(M,) the ids of their tracks."""
    xyz_in_world: Array
    """(M, 3)."""
    rgb: NDArray[np.uint8]
    """(M, 3)."""

    @staticmethod
    def empty() -> Landmarks:
        return Landmarks(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3), np.uint8))

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True)
class Decision:
    """A named check that steered the estimator: "parallax 14.2 px >= 20 px: no"."""

    name: str
    """What is compared, in words."""
    value: float
    threshold: float
    passed: bool
    unit: str = ""
    relation: Literal[">=", "<=", ">", "<", "="] = ">="
    consequence: str = ""
    """What followed, where that is not plain from the name."""
    key: str = ""
    """Stable name for plots, columns and break points, as in `parallax`; unique within a Step together with `about`."""
    question: str = ""
    """What the check helps to answer ("New key frame?"); empty where it stands for itself."""
    kind: Literal["requirement", "trigger", "finding"] = "requirement"
    """requirement: not passed is a failure; trigger: any one that passes answers the question with yes; finding: a
    measurement beside its threshold, where neither outcome is a failure."""
    about: str = ""
    """The track, pair or key frame that it is about, where a Step has the same check several times."""

    @property
    def failed(self) -> bool:
        return self.kind == "requirement" and not self.passed

    @property
    def margin(self) -> float:
        """By how much the value lies on the passing side of the threshold; negative on the other side."""
        gap = self.value - self.threshold
        return -abs(gap) if self.relation == "=" else -gap if self.relation in ("<", "<=") else gap

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        outcome = "yes" if self.passed else "no"
        text = f"{self.name} {self.value:.4g}{unit} {self.relation} {self.threshold:.4g}{unit}: {outcome}"
        return f"{text} ({self.consequence})" if self.consequence else text


class Status(StrEnum):
    INITIALISING = "initialising"
    TRACKING = "tracking"
    LOST = "lost"


@dataclass(frozen=True, eq=False)
class Step:
    """All that one estimator can say about one exposure."""

    time_ns: int
    status: Status
    frame: Frame = "rig"
    """Whose pose: the rig, or the video camera where the unit is unknown (the lever arm cannot be applied)."""
    world_from_frame: Pose | None = None
    covariance: Array | None = None
    """(6, 6) of the twist (rho, phi) on the right of the pose; None where the method has none."""
    key_frame: bool = False
    tracks: Mapping[str, Tracks] = field(default_factory=dict)
    """By camera name: video, left."""
    landmarks: Landmarks = field(default_factory=Landmarks.empty)
    """The points found or revised in this step (a viewer replaces by id)."""
    residuals_px: Array = field(default_factory=lambda: np.zeros(0))
    """(K,) reprojection errors of the inliers of the pose estimate."""
    revised: Trajectory = field(default_factory=Trajectory.empty)
    """Poses of earlier exposures that this step made better, or gave for the first time."""
    scale: float | None = None
    """The factor that carried the unit into this step (1 = kept); None where no scale was transferred."""
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Wall time per stage; the only values here that differ between runs."""
    decisions: tuple[Decision, ...] = ()
    parts: tuple[Step, ...] = ()
    """Steps of the estimators that this one is made of, at the same exposure."""
    scale_sigma: float | None = None
    """Standard deviation of the logarithm of the unit here, relative to that at the start; None where unknown."""
    method: str = ""
    """The method's name; put in by the ensemble."""
    final_until_ns: int | None = None
    """Poses before this time will hardly be revised any more; None where that is not known yet."""
    restarted: bool = False
    """A new world begins at this exposure: earlier poses share nothing with later ones but the last known pose."""
    calibration: Mapping[str, Array] = field(default_factory=dict)
    """What was found to be wrong with the calibration so far, by name: `pair` (4,) as solvers.window.Window.extra of
    two cameras, `pair_rate` (6,) the motion that its late right shutter sees (left_from_world's change: rho [m/s],
    phi [rad/s]; left), `lens` (2,) as that of one camera."""


@dataclass(frozen=True, eq=False)
class Sequence:
    """A time-ordered list of exposures with its rig; images are read when asked for."""

    name: str
    """What a person recognises: "sim:city seed 0", "KITTI 06"."""
    rig: Rig
    times_ns: NDArray[np.int64]
    """(N,) not decreasing; a stereo pair comes before the video frame of the same time."""
    kinds: tuple[Kind, ...]
    """(N,) what exposure i is."""
    load: Callable[[int], Exposure]
    """Reads exposure i; InputError where its files are unreadable or of the wrong size. Safe from several threads."""
    truth: Trajectory | None = None
    """world_from_rig, in the source's own world; may cover only part of the exposures."""
    notes: tuple[str, ...] = ()
    """What a person must know to read results of this sequence rightly (an emulation, a nominal frame rate)."""
    prepare: Callable[[int], None] | None = None
    """Renders or fetches ahead from exposure i on, in the background; None where loading is always quick."""
    grow: Callable[[int, float | None], Sequence] | None = None
    """Of a live source: waits for more than N exposures, at most so many seconds (None: until it ends), and gives the
    sequence of all that came so far. InputError where the source fails. None where nothing more will come."""
    stop: Callable[[], None] | None = None
    """Of a live source: ends the recording and frees the camera; what came so far stays."""

    def __len__(self) -> int:
        return len(self.times_ns)

    def __getitem__(self, i: int) -> Exposure:
        return self.load(i)

    def truncated(self, count: int) -> Sequence:
        """The first `count` exposures."""
        return replace(self, times_ns=self.times_ns[:count], kinds=self.kinds[:count])


def as_grey(image: Image) -> Image:
    """(H, W) of an RGB or grey image."""
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)


def colours_at(image: Image, uv: NDArray[np.float32]) -> NDArray[np.uint8]:
    """RGB (N, 3) of the pixels nearest to (N, 2); places outside give the nearest inside."""
    column = np.clip(np.rint(uv[:, 0]).astype(int), 0, image.shape[1] - 1)
    row = np.clip(np.rint(uv[:, 1]).astype(int), 0, image.shape[0] - 1)
    found = image[row, column]
    return np.repeat(found[:, None], 3, axis=1) if image.ndim == 2 else found
