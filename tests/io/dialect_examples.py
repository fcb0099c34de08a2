"""A small file of each dialect, as its program writes it, made of the values of one camera or one pair.

The camera: 320 x 240, fx 226, fy 227.5, cx 160.9, cy 118.3, k1 -0.22, k2 0.06, p1 0.0006, p2 -0.0004. The pair: 640 x 480,
fx = fy = 460, principal point in the middle, the right camera 0.4 m to the right. The fisheye: fx 190.9, cx 254.9, cy 256.9,
512 x 512, k1 to k4 0.0034, 0.0007, -0.002, 0.0002.
"""

# ruff: noqa: E501 - files as they are have long lines
from __future__ import annotations

import json
import struct
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO

import numpy as np

from ispom.geometry import Pose
from ispom.types import Camera

CAMERA = Camera(320, 240, 226.0, 227.5, 160.9, 118.3, (-0.22, 0.06, 0.0006, -0.0004))
PLAIN = Camera(320, 240, 226.0, 227.5, 160.9, 118.3)
SQUARE = Camera(320, 240, 226.0, 226.0, 160.9, 118.3, (-0.22, 0.06, 0.0006, -0.0004))
SIDE = Camera(640, 480, 460.0, 460.0, 319.5, 239.5)
FISHEYE = Camera(512, 512, 190.9, 190.9, 254.9, 256.9, (0.0034, 0.0007, -0.002, 0.0002), "fisheye")
TURN = Pose.from_rotvec(np.array([0.01, -0.02, 0.03]), np.zeros(3)).rotation
"""Of a right camera: left_from_right."""
LEFT_FROM_RIGHT = Pose(TURN, np.array([0.4, -0.003, 0.005]))
STRAIGHT = Pose(translation=np.array([0.4, 0.0, 0.0]))
IMU_FROM_LEFT = Pose.from_rotvec(np.array([0.3, 1.2, -0.4]), np.array([0.1, -0.02, 0.05]))


@dataclass(frozen=True)
class Example:
    """A file's name and content, and what must be read of it."""

    dialect: str
    name: str
    content: bytes
    expected: Camera
    """The only camera, or the left one."""
    left_from_right: Pose | None = None
    image_size: bool = False
    """The file has no size: that of the images is needed."""
    beside: tuple[tuple[str, bytes], ...] = ()
    rate_hz: float | None = None


def rows(matrix: np.ndarray, count: int = 4) -> str:
    """The first `count` rows as numbers with commas."""
    return ", ".join(repr(float(value)) for value in matrix[:count].ravel())


def _json(values: object) -> bytes:
    return json.dumps(values, indent=1).encode()


def _npz(**arrays: np.ndarray) -> bytes:
    file = BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def _npy(array: np.ndarray) -> bytes:
    file = BytesIO()
    np.save(file, array)
    return file.getvalue()


RIGHT_FROM_LEFT = LEFT_FROM_RIGHT.inverse()
IMU_FROM_RIGHT = IMU_FROM_LEFT @ LEFT_FROM_RIGHT
K_TEXT = "226.0 0.0 160.9\n0.0 227.5 118.3\n0.0 0.0 1.0\n"
ORB = """%YAML:1.0
Camera.fx: 226.0
Camera.fy: 227.5
Camera.cx: 160.9
Camera.cy: 118.3
Camera.k1: -0.22
Camera.k2: 0.06
Camera.p1: 0.0006
Camera.p2: -0.0004
Camera.fps: 30.0
Camera.RGB: 1
ORBextractor.nFeatures: 900
"""
ORB_SIDE = """%YAML:1.0
File.version: "1.0"
Camera.type: "{kind}"
Camera1.fx: 460.0
Camera1.fy: 460.0
Camera1.cx: 319.5
Camera1.cy: 239.5
Camera.width: 640
Camera.height: 480
Camera.fps: 20
"""
ORB_SECOND = "Camera2.fx: 460.0\nCamera2.fy: 460.0\nCamera2.cx: 319.5\nCamera2.cy: 239.5\n"
ORB_FISHEYE = """%YAML:1.0
Camera.type: "KannalaBrandt8"
Camera1.fx: 190.9
Camera1.fy: 190.9
Camera1.cx: 254.9
Camera1.cy: 256.9
Camera1.k1: 0.0034
Camera1.k2: 0.0007
Camera1.k3: -0.002
Camera1.k4: 0.0002
Camera.width: 512
Camera.height: 512
Camera.fps: 20
"""


def _matrix(name: str, matrix: np.ndarray, count: int = 4) -> str:
    data = rows(matrix, count)
    return f"{name}: !!opencv-matrix\n   rows: {count}\n   cols: {matrix.shape[1]}\n   dt: f\n   data: [ {data} ]\n"


STELLA = """Camera:
  name: "c"
  setup: "{setup}"
  model: "perspective"
  fx: {f[0]}
  fy: {f[1]}
  cx: {f[2]}
  cy: {f[3]}
  k1: {k[0]}
  k2: {k[1]}
  p1: {k[2]}
  p2: {k[3]}
  k3: 0.0
  fps: 30.0
  cols: {size[0]}
  rows: {size[1]}
  focal_x_baseline: 184.0
Feature:
  name: "default"
"""
STELLA_DOTTED = """Camera.name: "c"
Camera.setup: "monocular"
Camera.model: "fisheye"
Camera.fx: 190.9
Camera.fy: 190.9
Camera.cx: 254.9
Camera.cy: 256.9
Camera.k1: 0.0034
Camera.k2: 0.0007
Camera.k3: -0.002
Camera.k4: 0.0002
Camera.fps: 30.0
Camera.cols: 512
Camera.rows: 512
"""
VINS = """%YAML:1.0
---
model_type: PINHOLE
camera_name: camera
image_width: 320
image_height: 240
distortion_parameters:
   k1: -0.22
   k2: 0.06
   p1: 0.0006
   p2: -0.0004
projection_parameters:
   fx: 226.0
   fy: 227.5
   cx: 160.9
   cy: 118.3
"""
VINS_FISHEYE = """%YAML:1.0
---
model_type: KANNALA_BRANDT
camera_name: camera
image_width: 512
image_height: 512
projection_parameters:
   k2: 0.0034
   k3: 0.0007
   k4: -0.002
   k5: 0.0002
   mu: 190.9
   mv: 190.9
   u0: 254.9
   v0: 256.9
"""
VINS_SIDE = (
    "%YAML:1.0\n---\nmodel_type: PINHOLE\ncamera_name: c\nimage_width: 640\nimage_height: 480\n"
    "distortion_parameters: {k1: 0, k2: 0, p1: 0, p2: 0}\n"
    "projection_parameters: {fx: 460.0, fy: 460.0, cx: 319.5, cy: 239.5}\n"
)
VINS_SETTINGS = (
    '%YAML:1.0\n\nimu: 1\nnum_of_cam: 2\ncam0_calib: "cam0.yaml"\ncam1_calib: "cam1.yaml"\nimage_width: 640\n'
    "image_height: 480\n" + _matrix("body_T_cam0", IMU_FROM_LEFT.matrix) + _matrix("body_T_cam1", IMU_FROM_RIGHT.matrix)
)
OKVIS = "%YAML:1.0\ncameras:\n" + "".join(
    f"     - {{T_SC:\n        [{rows(pose.matrix)}],\n        image_dimension: [640, 480],\n"
    "        distortion_coefficients: [0.0, 0.0, 0.0, 0.0],\n        distortion_type: radialtangential,\n"
    "        focal_length: [460.0, 460.0],\n        principal_point: [319.5, 239.5]}\n"
    for pose in (IMU_FROM_LEFT, IMU_FROM_RIGHT)
)
SVO = "label: rig\ncameras:\n" + "".join(
    f"- camera:\n    label: cam{n}\n    image_height: 480\n    image_width: 640\n    type: pinhole\n    intrinsics:\n"
    "      cols: 1\n      rows: 4\n      data: [460.0, 460.0, 319.5, 239.5]\n    distortion:\n"
    "      type: radial-tangential\n      parameters:\n        cols: 1\n        rows: 4\n        data: [0, 0, 0, 0]\n"
    f"  T_B_C:\n    cols: 4\n    rows: 4\n    data: [{rows(pose.matrix)}]\n"
    for n, pose in enumerate((IMU_FROM_LEFT, IMU_FROM_RIGHT))
)
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
EDEX = [
    {"version": "0.9", "frame_start": 0, "frame_end": 8, "cameras": [
        {"id": n, "transform": (_FLIP @ pose.matrix @ _FLIP)[:3].tolist(), "intrinsics": {
            "distortion_model": "brown5k", "distortion_params": [-0.22, 0.06, 0.0, 0.0006, -0.0004],
            "focal": [226.0, 227.5], "principal": [160.9, 118.3], "size": [320, 240]}}
        for n, pose in enumerate((Pose(), LEFT_FROM_RIGHT))
    ]}, {"sequence": []},
]  # fmt: skip
ZED = """[LEFT_CAM_HD]
fx=700
fy=700
cx=640
cy=360
k1=0
k2=0
[RIGHT_CAM_HD]
fx=700
fy=700
cx=640
cy=360
[LEFT_CAM_VGA]
fx=226.0
fy=227.5
cx=330.9
cy=188.3
k1=-0.22
k2=0.06
k3=0
p1=0.0006
p2=-0.0004

[RIGHT_CAM_VGA]
fx=226.0
fy=227.5
cx=330.9
cy=188.3
k1=-0.22
k2=0.06
k3=0
p1=0.0006
p2=-0.0004

[STEREO]
Baseline={0}
TY={1}
TZ={2}
RX_VGA={3}
CV_VGA={4}
RZ_VGA={5}
"""
VGA = Camera(672, 376, 226.0, 227.5, 330.9, 188.3, (-0.22, 0.06, 0.0006, -0.0004))
ZED = ZED.format(*(-1000 * RIGHT_FROM_LEFT.translation), *RIGHT_FROM_LEFT.rotvec)


def _stream(name: str, width: int, height: int, f: tuple[float, ...], coefficients: str) -> str:
    return (
        f' Intrinsic of "{name}" / {width}x{height} / {{Y8}}\n  Width:      \t{width}\n  Height:     \t{height}\n'
        f"  PPX:        \t{f[2]}\n  PPY:        \t{f[3]}\n  Fx:         \t{f[0]}\n  Fy:         \t{f[1]}\n"
        f"  Distortion: \tBrown Conrady\n  Coeffs:     \t{coefficients}  \n  FOV (deg):  \t69.37 x 42.54\n\n"
    )


def _extrinsic(one: str, other: str, pose: Pose) -> str:
    lines = "".join("   " + "   \t".join(f"{value:.12g}" for value in row) + "  \n" for row in pose.rotation)
    shift = "  ".join(f"{value:.12g}" for value in pose.translation)
    return (
        f'Extrinsic from "{one}"\t  To\t  "{other}" :\n Rotation Matrix:\n{lines}\n Translation Vector: {shift}  \n\n'
    )


_ZERO = "0  \t0  \t0  \t0  \t0"
REALSENSE = (
    "Device info: \n    Name : Intel RealSense D435I\nIntrinsic Parameters:\n\n"
    + _stream("Depth", 640, 480, (460.0, 460.0, 319.5, 239.5), _ZERO)
    + _stream("Infrared 1", 640, 480, (460.0, 460.0, 319.5, 239.5), _ZERO)
    + _stream("Infrared 1", 320, 240, (230.0, 230.0, 159.5, 119.5), _ZERO)
    + _stream("Infrared 2", 640, 480, (460.0, 460.0, 319.5, 239.5), _ZERO)
    + "Extrinsic Parameters:\n"
    + _extrinsic("Infrared 1", "Infrared 1", Pose())
    + _extrinsic("Infrared 1", "Infrared 2", RIGHT_FROM_LEFT)
    + _extrinsic("Infrared 2", "Infrared 1", LEFT_FROM_RIGHT)
)
REALSENSE_COLOR = (
    "Provided Intrinsic:\n" + _stream("Color", 320, 240, (226.0, 227.5, 160.9, 118.3), "-0.22 0.06 0.0006 -0.0004 0")
    + _stream("Color", 1280, 720, (900.0, 900.0, 640.0, 360.0), _ZERO)
)  # fmt: skip


def _socket(pose: Pose | None, to: int) -> dict[str, object]:
    pose = Pose() if pose is None else pose
    x, y, z = (100 * pose.translation).tolist()
    return {
        "cameraType": 0, "distortionCoeff": [-0.22, 0.06, 0.0006, -0.0004] + [0.0] * 10, "height": 240, "width": 320,
        "intrinsicMatrix": [[226.0, 0.0, 160.9], [0.0, 227.5, 118.3], [0.0, 0.0, 1.0]], "lensPosition": 0,
        "extrinsics": {"rotationMatrix": pose.rotation.tolist(), "toCameraSocket": to,
                       "specTranslation": {"x": 0.0, "y": 0.0, "z": 0.0}, "translation": {"x": x, "y": y, "z": z}},
    }  # fmt: skip


DEPTHAI = {"boardName": "OAK", "cameraData": [[1, _socket(RIGHT_FROM_LEFT, 2)], [2, _socket(None, -1)]]}
NERF = {
    "camera_model": "OPENCV", "fl_x": 226.0, "fl_y": 227.5, "cx": 161.4, "cy": 118.8, "w": 320, "h": 240, "k1": -0.22,
    "k2": 0.06, "p1": 0.0006, "p2": -0.0004, "applied_transform": [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0]],
    "frames": [{"file_path": "images/0000.png", "transform_matrix": np.eye(4).tolist()}],
}  # fmt: skip
NERF_FRAMES = {
    "frames": [
        {"file_path": f"images/{n}.png", "transform_matrix": np.eye(4).tolist(), "fl_x": f, "fl_y": 227.5, "cx": 160.9,
         "cy": 118.3, "w": 320, "h": 240, "k1": -0.22, "k2": 0.06, "p1": 0.0006, "p2": -0.0004}
        for n, f in enumerate((225.9, 226.0, 226.1))
    ]
}  # fmt: skip
METASHAPE = """<?xml version="1.0" encoding="UTF-8"?>
<calibration>
  <projection>frame</projection>
  <width>320</width>
  <height>240</height>
  <f>227.5</f>
  <cx>1.4</cx>
  <cy>-1.2</cy>
  <b1>-1.5</b1>
  <k1>-0.22</k1>
  <k2>0.06</k2>
  <p1>-0.0004</p1>
  <p2>0.0006</p2>
  <date>2024-01-01T00:00:00Z</date>
</calibration>
"""
METASHAPE_DOCUMENT = """<?xml version="1.0" encoding="UTF-8"?>
<document version="1.5.0"><chunk label="c" enabled="true"><sensors next_id="1">
<sensor id="0" label="cam" type="fisheye"><resolution width="512" height="512"/>
<calibration type="fisheye" class="initial"><resolution width="512" height="512"/><f>200</f></calibration>
<calibration type="fisheye" class="adjusted"><resolution width="512" height="512"/><f>190.9</f><cx>-0.6</cx><cy>1.4</cy>
<k1>0.0034</k1><k2>0.0007</k2><k3>-0.002</k3><k4>0.0002</k4></calibration></sensor></sensors></chunk></document>
"""
OPENSFM = {
    "v2 unknown unknown 320 240 brown 0.85": {
        "projection_type": "brown", "width": 320, "height": 240, "focal_x": 226 / 320, "focal_y": 227.5 / 320,
        "c_x": (160.9 - 159.5) / 320, "c_y": (118.3 - 119.5) / 320, "k1": -0.22, "k2": 0.06, "p1": 0.0006, "p2": -0.0004,
        "k3": 0.0}
}  # fmt: skip
MRCAL = """# generated on 2024-01-01
{
    'lensmodel':  'LENSMODEL_OPENCV4',

    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....
    'intrinsics': [ 226.0, 227.5, 160.9, 118.3, -0.22, 0.06, 0.0006, -0.0004, ],

    # extrinsics are rt_fromref
    'extrinsics': [ 0,0,0, 0,0,0, ],

    'imagersize': [ 320, 240,],
    'optimization_inputs': b'P)h>@6aWAK00{8A2mk;8AprmY0H{{f001Et`~-',
}
"""


def _parameters() -> dict[str, object]:
    values = {"f": 226.0, "ar": 227.5 / 226.0, "cx": 160.9, "cy": 118.3, "k1": -0.22, "k2": 0.06, "p1": 0.0006}
    values |= {"p2": -0.0004, "k3": 0.0, "k4": 0.0, "k5": 0.0, "k6": 0.0, "s1": 0.0, "tauX": 0.0}
    return {key: {"state": 1, "val": value} for key, value in values.items()}


def _calibio(n: int, pose: Pose) -> dict[str, object]:
    (rx, ry, rz), (x, y, z) = pose.rotvec.tolist(), pose.translation.tolist()
    name = {"polymorphic_name": "libCalib::CameraModelOpenCV"} if n == 0 else {}
    base = {"CameraModelBase": {"imageSize": {"width": 320, "height": 240}}}
    return {
        "model": {"polymorphic_id": 2147483649 if n == 0 else 1, **name,
                  "ptr_wrapper": {"id": n, "data": {"parameters": _parameters(), "CameraModelCRT": base}}},
        "transform": {"rotation": {"rx": rx, "ry": ry, "rz": rz}, "translation": {"x": x, "y": y, "z": z}},
    }  # fmt: skip


CALIBIO = {"Calibration": {"cameras": [_calibio(n, pose) for n, pose in enumerate((Pose(), RIGHT_FROM_LEFT))]}}


def _basalt(pose: Pose) -> dict[str, float]:
    names = ("px", "py", "pz", "qx", "qy", "qz", "qw")
    return dict(zip(names, [*pose.translation.tolist(), *pose.xyzw.tolist()], strict=True))


BASALT = {
    "value0": {
        "T_imu_cam": [_basalt(IMU_FROM_LEFT), _basalt(IMU_FROM_RIGHT)],
        "intrinsics": [
            {"camera_type": "kb4", "intrinsics": {"fx": 190.9, "fy": 190.9, "cx": 254.9, "cy": 256.9, "k1": 0.0034,
                                                  "k2": 0.0007, "k3": -0.002, "k4": 0.0002}}
        ] * 2,
        "resolution": [[512, 512], [512, 512]], "cam_time_offset_ns": 0,
    }
}  # fmt: skip
OPEN3D = {"width": 320, "height": 240, "intrinsic_matrix": [226.0, 0, 0, 0, 227.5, 0, 160.9, 118.3, 1]}
KITTI = (
    "P0: 460 0 319.5 0 0 460 239.5 0 0 0 1 0\nP1: 460 0 319.5 -184 0 460 239.5 0 0 0 1 0\nTr: 1 0 0 0 0 1 0 0 0 0 1 0\n"
)
MATLAB = """cameraParams =

  cameraParameters with properties:

   Camera Intrinsics
             FocalLength: [226.0 227.5]
          PrincipalPoint: [161.9 119.3]
               ImageSize: [240 320]
                    Skew: 0

   Lens Distortion
        RadialDistortion: [-0.22 0.06]
    TangentialDistortion: [0.0006 -0.0004]
"""
CALTECH = """% Intrinsic and Extrinsic Camera Parameters
%-- Focal length:
fc = [ 226.000000000000000 ; 227.500000000000000 ];
%-- Principal point:
cc = [ 160.900000000000006 ; 118.299999999999997 ];
%-- Skew coefficient:
alpha_c = 0.000000000000000;
%-- Distortion coefficients:
kc = [ -0.220000000000000 ; 0.060000000000000 ; 0.000600000000000 ; -0.000400000000000 ; 0.000000000000000 ];
fc_error = [ 0.5 ; 0.5 ];
nx = 320;
ny = 240;
"""
CALTECH_PAIR = (
    "fc_left = [ 460 460 ] ± [ 0.8 0.8 ];\ncc_left = [ 319.5 239.5 ];\nalpha_c_left = [ 0 ];\nkc_left = [ 0 0 0 0 0 ];\n"
    "fc_right = [ 460 460 ];\ncc_right = [ 319.5 239.5 ];\nkc_right = [ 0 0 0 0 0 ];\n"
    f"om = [ {' '.join(map(repr, RIGHT_FROM_LEFT.rotvec.tolist()))} ];\n"
    f"T = [ {' '.join(repr(1000 * value) for value in RIGHT_FROM_LEFT.translation.tolist())} ];\nnx = 640;\nny = 480;\n"
)
MATLAB_ROWS = "226.0 0 0\n0 227.5 0\n161.9 119.3 1\n"
COLMAP = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
COLMAP += "# Number of cameras: 1\n1 OPENCV 320 240 226.0 227.5 161.4 118.8 -0.22 0.06 0.0006 -0.0004\n"
COLMAP_BINARY = struct.pack("<QiiQQ8d", 1, 1, 4, 320, 240, 226.0, 227.5, 161.4, 118.8, -0.22, 0.06, 0.0006, -0.0004)
DSO_FISHEYE = (
    f"EquiDistant {190.9 / 512!r} {190.9 / 512!r} {255.4 / 512!r} {257.4 / 512!r} 0.0034 0.0007 -0.002 0.0002\n"
)
K3 = np.array([[226.0, 0, 160.9], [0, 227.5, 118.3], [0, 0, 1]])
D5 = np.array([[-0.22, 0.06, 0.0006, -0.0004, 0.0]])
K_SIDE = np.array([[460.0, 0, 319.5], [0, 460.0, 239.5], [0, 0, 1]])
OWN = (
    "width: 320\nheight: 240\nfx: 226.0\nfy: 227.5\ncx: 160.9\ncy: 118.3\ndistortion: [-0.22, 0.06, 0.0006, -0.0004]\n"
)
OPENCV = "%YAML:1.0\n---\nimage_width: 320\nimage_height: 240\n" + _matrix("camera_matrix", K3, 3)
OPENCV += _matrix("distortion_coefficients", D5, 1)
ROS = (
    "image_width: 320\nimage_height: 240\ncamera_name: c\ncamera_matrix: {rows: 3, cols: 3, data: "
    f"[{rows(K3, 3)}]}}\ndistortion_model: plumb_bob\ndistortion_coefficients: {{rows: 1, cols: 5, data: [{rows(D5, 1)}]}}\n"
    "rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n"
    f"projection_matrix: {{rows: 3, cols: 4, data: [226.0, 0, 160.9, 0, 0, 227.5, 118.3, 0, 0, 0, 1, 0]}}\n"
)
KALIBR = "".join(
    f"cam{n}:\n  camera_model: pinhole\n  distortion_coeffs: [0, 0, 0, 0]\n  distortion_model: radtan\n"
    f"  intrinsics: [460.0, 460.0, 319.5, 239.5]\n  resolution: [640, 480]\n{pose}"
    for n, pose in enumerate(("", f"  T_cn_cnm1: [{rows(RIGHT_FROM_LEFT.matrix)}]\n"))
)
TUM_VI = (
    "%YAML:1.0\nsensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n"
    f"  data: [{rows(IMU_FROM_LEFT.matrix)}]\nrate_hz: 20\nresolution: [512, 512]\ncamera_model: pinhole\n"
    "intrinsics: [190.9, 190.9, 254.9, 256.9]\ndistortion_model: equidistant\n"
    "distortion_coefficients: [0.0034, 0.0007, -0.002, 0.0002]\n"
)
RIG = """left: {width: 640, height: 480, fx: 460.0, fy: 460.0, cx: 319.5, cy: 239.5, distortion: [],
  rig_from_left: {translation_m: [0, 0, 0], rotation_xyzw: [0, 0, 0, 1]}}
right: {width: 640, height: 480, fx: 460.0, fy: 460.0, cx: 319.5, cy: 239.5, distortion: [],
  rig_from_right: {translation_m: [0.4, 0, 0], rotation_xyzw: [0, 0, 0, 1]}}
"""


def _text(dialect: str, name: str, text: str, expected: Camera, *more: object, **others: object) -> Example:
    return Example(dialect, name, text.encode(), expected, *more, **others)  # type: ignore[arg-type]


_SIDES = ((226.0, 227.5, 160.9, 118.3), (-0.22, 0.06, 0.0006, -0.0004), (320, 240))
_PAIR = ((460.0, 460.0, 319.5, 239.5), (0.0,) * 4, (640, 480))
EXAMPLES: tuple[Example, ...] = (
    _text("ispom_camera", "camera.yaml", OWN, CAMERA),
    _text("ispom_rig", "rig.yaml", RIG, SIDE, STRAIGHT),
    _text("opencv", "calibration.yml", OPENCV, CAMERA),
    _text("opencv", "ost.yaml", ROS, CAMERA),
    _text("kalibr", "camchain.yaml", KALIBR, SIDE, LEFT_FROM_RIGHT),
    _text("euroc", "sensor.yaml", TUM_VI, FISHEYE),
    _text("orbslam", "mono.yaml", ORB, CAMERA, image_size=True, rate_hz=30.0),
    _text("orbslam", "rectified.yaml", ORB_SIDE.format(kind="Rectified") + "Stereo.b: 0.4\n", SIDE, STRAIGHT),
    _text("orbslam", "bf.yaml", ORB_SIDE.format(kind="PinHole").replace("Camera1", "Camera") + "Camera.bf: 184.0\n", SIDE, STRAIGHT),
    _text("orbslam", "rgbd.yaml", ORB + "Camera.bf: 40.0\nDepthMapFactor: 5000.0\n", CAMERA, image_size=True, rate_hz=30.0),
    _text(
        "orbslam", "stereo.yaml",
        ORB_SIDE.format(kind="PinHole") + ORB_SECOND + _matrix("Stereo.T_c1_c2", LEFT_FROM_RIGHT.matrix),
        SIDE, LEFT_FROM_RIGHT,
    ),
    _text(
        "orbslam", "old_fisheye_pair.yaml",
        ORB_FISHEYE.replace("Camera1", "Camera") + ORB_FISHEYE[ORB_FISHEYE.index("Camera1.fx") : ORB_FISHEYE.index("Camera.width")]
        .replace("Camera1", "Camera2") + _matrix("Tlr", LEFT_FROM_RIGHT.matrix, 3),
        FISHEYE, LEFT_FROM_RIGHT,
    ),
    _text("orbslam", "kb8.yaml", ORB_FISHEYE, FISHEYE, rate_hz=20.0),
    _text(
        "orbslam", "raw_pair.yaml",
        ORB_SIDE.format(kind="PinHole").replace("Camera1", "Camera") + "Camera.bf: 184.0\n"
        + "".join(
            f"{side}.width: 640\n{side}.height: 480\n" + _matrix(f"{side}.K", K_SIDE, 3)
            + _matrix(f"{side}.D", np.zeros((1, 5)), 1) + _matrix(f"{side}.R", np.eye(3), 3)
            + _matrix(f"{side}.P", np.column_stack([K_SIDE, [shift, 0, 0]]), 3)
            for side, shift in (("LEFT", 0.0), ("RIGHT", -184.0))
        ),
        SIDE, STRAIGHT,
    ),
    _text("stella_vslam", "nested.yaml", STELLA.format(setup="monocular", f=_SIDES[0], k=_SIDES[1], size=_SIDES[2]), CAMERA, rate_hz=30.0),
    _text("stella_vslam", "pair.yaml", STELLA.format(setup="stereo", f=_PAIR[0], k=_PAIR[1], size=_PAIR[2]), SIDE, STRAIGHT),
    _text("stella_vslam", "dotted.yaml", STELLA_DOTTED, FISHEYE, rate_hz=30.0),
    _text("vins", "pinhole.yaml", VINS, CAMERA),
    _text("vins", "kannala_brandt.yaml", VINS_FISHEYE, FISHEYE),
    _text(
        "vins", "settings.yaml", VINS_SETTINGS, SIDE, LEFT_FROM_RIGHT,
        beside=(("cam0.yaml", VINS_SIDE.encode()), ("cam1.yaml", VINS_SIDE.encode())),
    ),
    _text("okvis", "okvis.yaml", OKVIS, SIDE, LEFT_FROM_RIGHT),
    _text("svo", "calib.yaml", SVO, SIDE, LEFT_FROM_RIGHT),
    Example("cuvslam", "stereo.edex", _json(EDEX), CAMERA, LEFT_FROM_RIGHT),
    _text("dso", "radtan.txt", "RadTan 226.0 227.5 160.9 118.3 -0.22 0.06 0.0006 -0.0004\n320 240\ncrop\n320 240\n", CAMERA),
    _text("dso", "pinhole.txt", "Pinhole 226.0 227.5 160.9 118.3 0\n320 240\nnone\n320 240\n", PLAIN),
    _text("dso", "relative.txt", DSO_FISHEYE + "512 512\n0.4 0.53 0.5 0.5 0\n640 480\n", FISHEYE),
    _text("matrix", "K.txt", K_TEXT, PLAIN, image_size=True),
    _text("matrix", "intrinsic_color.txt", "226 0 160.9 0\n0 227.5 118.3 0\n0 0 1 0\n0 0 0 1\n", PLAIN, image_size=True),
    _text("matrix", "camera_matrix.csv", K_TEXT.replace(" ", ","), PLAIN, image_size=True),
    _text("matrix", "printed.txt", "[[226.0, 0., 160.9],\n [0., 227.5, 118.3],\n [0., 0., 1.]]\n", PLAIN, image_size=True),
    _text("matrix", "matlab_rows.txt", MATLAB_ROWS, PLAIN, image_size=True),
    _text("droid", "calib.txt", "226.0 227.5 160.9 118.3 -0.22 0.06 0.0006 -0.0004\n", CAMERA, image_size=True),
    _text("droid", "plain.txt", "226.0 227.5 160.9 118.3\n", PLAIN, image_size=True),
    Example("numpy_file", "calibration.npz", _npz(mtx=K3, dist=D5, rvecs=np.zeros((300, 3))), CAMERA, image_size=True),
    Example(
        "numpy_file", "stereo.npz",
        _npz(K1=K_SIDE, D1=np.zeros(5), K2=K_SIDE, D2=np.zeros(5), R=RIGHT_FROM_LEFT.rotation,
             T=RIGHT_FROM_LEFT.translation[:, None], image_size=np.array([640, 480])),
        SIDE, LEFT_FROM_RIGHT,
    ),
    Example("numpy_file", "K.npy", _npy(K3), PLAIN, image_size=True),
    _text("zed", "SN12345.conf", ZED, VGA, LEFT_FROM_RIGHT, image_size=True),
    _text("realsense", "rs.txt", REALSENSE, SIDE, LEFT_FROM_RIGHT, image_size=True),
    Example("realsense", "powershell.txt", REALSENSE_COLOR.encode("utf-16"), CAMERA, image_size=True),
    Example("depthai", "calib.json", _json(DEPTHAI), CAMERA, LEFT_FROM_RIGHT),
    Example("nerfstudio", "transforms.json", _json(NERF), CAMERA),
    Example("nerfstudio", "frames.json", _json(NERF_FRAMES), CAMERA),
    _text("metashape", "calibration.xml", METASHAPE, CAMERA),
    _text("metashape", "cameras.xml", METASHAPE_DOCUMENT, FISHEYE),
    Example("opensfm", "camera_models.json", _json(OPENSFM), CAMERA),
    _text("mrcal", "camera-0.cameramodel", MRCAL, CAMERA),
    Example("calibio", "calibration.json", _json(CALIBIO), CAMERA, LEFT_FROM_RIGHT),
    Example("basalt", "basalt.json", _json(BASALT), FISHEYE, LEFT_FROM_RIGHT),
    Example("open3d", "camera_intrinsic.json", _json(OPEN3D), PLAIN),
    _text("kitti", "calib.txt", KITTI, SIDE, STRAIGHT, image_size=True),
    _text("matlab", "printed.txt", MATLAB, CAMERA),
    _text("matlab", "Calib_Results.m", CALTECH, CAMERA),
    _text("matlab", "pair.m", CALTECH_PAIR, SIDE, LEFT_FROM_RIGHT),
    _text("colmap", "cameras.txt", COLMAP, CAMERA),
    Example("colmap", "cameras.bin", COLMAP_BINARY, CAMERA),
)  # fmt: skip


NAMED: tuple[tuple[str, str, bytes, str], ...] = (
    ("orbslam", "o.yaml", ORB.replace("%YAML:1.0\n", '%YAML:1.0\nCamera.type: "Spherical"\n').encode(), "Spherical"),
    ("stella_vslam", "s.yaml", STELLA_DOTTED.replace('"fisheye"', '"equirectangular"').encode(), "equirectangular"),
    ("vins", "mei.yaml", VINS.replace("PINHOLE", "MEI").encode(), "MEI"),
    ("okvis", "ok.yaml", OKVIS.replace("radialtangential", "fov").encode(), "fov"),
    ("svo", "svo.yaml", SVO.replace("radial-tangential", "fisheye").encode(), "fisheye"),
    ("cuvslam", "c.edex", _json(EDEX).replace(b"brown5k", b"ftheta"), "ftheta"),
    ("dso", "fov.txt", b"0.349 0.436 0.493 0.499 0.933\n1280 1024\n0.4 0.53 0.5 0.5 0\n640 480\n", "FOV"),
    ("depthai", "d.json", _json(DEPTHAI).replace(b'"cameraType": 0', b'"cameraType": 3'), "cameraType 3"),
    ("nerfstudio", "n.json", _json(NERF | {"camera_model": "EQUIRECTANGULAR"}), "EQUIRECTANGULAR"),
    ("nerfstudio", "k4.json", _json(NERF | {"k4": 0.1}), "k4"),
    ("metashape", "m.xml", METASHAPE.replace("frame", "spherical").encode(), "spherical"),
    ("metashape", "p3.xml", METASHAPE.replace("<b1>", "<p3>0.1</p3><b1>").encode(), "p3"),
    ("opensfm", "os.json", _json(OPENSFM).replace(b"brown\",", b"fisheye62\","), "fisheye62"),
    ("mrcal", "x.cameramodel", MRCAL.replace("OPENCV4", "SPLINED_STEREOGRAPHIC_order=3").encode(), "SPLINED"),
    ("calibio", "ci.json", _json(CALIBIO).replace(b"CameraModelOpenCV", b"CameraModelOcam"), "CameraModelOcam"),
    ("basalt", "b.json", _json(BASALT).replace(b"kb4", b"ds"), "camera_type ds"),
    ("matlab", "c.mat", b"MATLAB 5.0 MAT-file, Platform: GLNXA64" + bytes(100), "binary .mat"),
    ("colmap", "cameras.txt", COLMAP.replace("OPENCV", "THIN_PRISM_FISHEYE").encode(), "THIN_PRISM_FISHEYE"),
    ("colmap", "cameras.bin", struct.pack("<QiiQQ5d", 1, 1, 7, 320, 240, 226, 226, 160, 120, 0.9), "FOV"),
    ("numpy_file", "p.pkl", b"\x80\x04\x95\x10\x00", "pickle"),
    ("numpy_file", "o.npy", _npy(np.array([{"a": 1}], dtype=object)), "Python objects"),
    ("realsense", "i.txt", REALSENSE_COLOR.replace("Brown Conrady", "Inverse Brown Conrady").encode(), "inverse brown"),
)  # fmt: skip
"""Files that are recognised and cannot be read: dialect, name, content, and a word of the sentence."""


def mutations(content: bytes, count: int, seed: int) -> list[bytes]:
    """Returns damaged versions of a file: cut, with other bytes, words or lines."""
    random = np.random.default_rng(seed)
    words = [
        b"nan",
        b"inf",
        b"1e400",
        b"-1",
        b"0",
        b"",
        b"[",
        b"{",
        b"\x00",
        b"9" * 400,
        b"a: b",
        b"null",
        b"\xff\xfe",
        b"1e12",
    ]
    changes: list[Callable[[bytes], bytes]] = [
        lambda data: data[: random.integers(0, len(data))],
        lambda data: data[:(at := int(random.integers(0, len(data))))] + bytes([random.integers(0, 256)]) + data[at + 1 :],
        lambda data: data[:(at := int(random.integers(0, len(data))))] + words[random.integers(len(words))] + data[at + int(random.integers(0, 12)) :],
        lambda data: b"\n".join(line for line in data.split(b"\n") if random.random() > 0.15),
        lambda data: data + data,
    ]  # fmt: skip
    return [changes[n % len(changes)](content) for n in range(count)]
