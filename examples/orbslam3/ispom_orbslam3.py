"""ORB-SLAM3 as a program that ISPOM starts: its poses, map points in the image, and tracking state, frame by frame.

ORB-SLAM3 (Campos et al., T-RO 2021) is under the GPL and stays a process of its own, which talks to ISPOM by the
protocol of external programs (version 1). It is used by the documented functions of the package pyorbslam3. It has
threads that run side by side, so two runs differ; `ispom diff` names where they first do.

`--vocabulary FILE`: ORBvoc.txt, or one of make_vocabulary.py; `--monocular`; `--features N` per image.
"""

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path

import numpy as np

MIN_TRACKED = 30
"""Tracked map points below which ORB-SLAM3 gives up a frame (Tracking::TrackLocalMap)."""
NEAREST_PX = 8.0
"""A keypoint belongs to a map point whose projection is not farther away. ORB-SLAM3 rejects residuals beyond 2.8 px
times the scale of the pyramid's level, which is 3.6 at most."""
SAME_SHARE = 0.02
"""Map points of two frames are the same if they are nearest to each other, and nearer than this share of their depth.
Bundle adjustment moves a point from frame to frame, and the package gives no identities."""
CHECKS = [
    {"key": "tracked_points", "name": "map points tracked", "question": "Tracked?"},
    {"key": "map_changed", "name": "big map changes", "kind": "trigger", "question": "Loop closed or map adjusted?"},
    {"key": "tracking_state", "name": "tracking state", "kind": "finding"},
    {"key": "keypoints", "name": "keypoints in the image", "kind": "finding"},
]


def settings_text(rig, monocular, features):
    """The settings file of ORB-SLAM3; the viewer's part is required, though no viewer is started."""
    camera = rig["video" if monocular else "left"]
    values = {name: float(camera[name]) for name in ("fx", "fy", "cx", "cy")}
    distortion = [*camera.get("distortion", ()), 0.0, 0.0, 0.0, 0.0][:4] if monocular else [0.0] * 4
    values |= dict(zip(("k1", "k2", "p1", "p2"), map(float, distortion), strict=True))
    lines = ["%YAML:1.0", 'Camera.type: "PinHole"', *(f"Camera.{name}: {value!r}" for name, value in values.items())]
    lines += [f"Camera.width: {camera['width']}", f"Camera.height: {camera['height']}", "Camera.fps: 10.0"]
    lines += ["Camera.RGB: 1"]
    if not monocular:
        lines += [f"Camera.bf: {values['fx'] * baseline(rig)!r}", "ThDepth: 40.0"]
    lines += [f"ORBextractor.nFeatures: {features}", "ORBextractor.scaleFactor: 1.2", "ORBextractor.nLevels: 8"]
    lines += ["ORBextractor.iniThFAST: 12", "ORBextractor.minThFAST: 7"]
    sizes = ("KeyFrameSize", "KeyFrameLineWidth", "GraphLineWidth", "PointSize", "CameraSize", "CameraLineWidth")
    lines += [f"Viewer.{name}: 1.0" for name in sizes]
    lines += [
        f"Viewer.Viewpoint{name}: {value}" for name, value in zip("XYZF", (0.0, -100.0, -0.1, 2000.0), strict=True)
    ]
    return "\n".join(lines) + "\n"


def baseline(rig):
    """Of the rectified pair [m]."""
    places = [rig[name][f"rig_from_{name}"]["translation_m"] for name in ("left", "right")]
    return float(np.linalg.norm(np.subtract(*places)))


def quaternion_xyzw(rotation):
    """Of a rotation matrix (3, 3): the eigenvector that belongs to the largest eigenvalue (Bar-Itzhack 2000)."""
    (a, b, c), (d, e, f), (g, h, i) = rotation
    k = [[a - e - i, b + d, c + g, h - f], [0, e - a - i, f + h, c - g], [0, 0, i - a - e, d - b], [0, 0, 0, a + e + i]]
    return np.linalg.eigh(np.array(k).T)[1][:, -1]


class Tracks:
    """Gives map points identities, and finds their keypoints."""

    def __init__(self, camera):
        self.camera, self.next = camera, 0
        self.end()

    def end(self):
        """All tracks end, as in a frame without a pose; their identities are never used again."""
        self.ids, self.points = np.zeros(0, int), np.zeros((0, 3))

    def answer(self, points, keypoints, camera_from_world):
        """`points` (N, 3) in the world, `keypoints` (M, 2) without distortion: the tracks of this frame."""
        seen = points @ camera_from_world[:3, :3].T + camera_from_world[:3, 3]
        points, seen = points[seen[:, 2] > 0], seen[seen[:, 2] > 0]
        place, near = mutual(self.projected(seen), keypoints, np.full(len(seen), NEAREST_PX))
        points, uv, depth = points[place], self.distorted(keypoints[near]), seen[place, 2]
        now, before = mutual(points, self.points, SAME_SHARE * depth)
        ids = np.full(len(points), -1)
        ids[now] = self.ids[before]
        new = np.flatnonzero(ids < 0)
        ids[new] = self.next + np.arange(len(new))
        self.next += len(new)
        self.ids, self.points = ids, points
        inside = ((uv >= 0) & (uv <= (self.camera["width"] - 1, self.camera["height"] - 1))).all(axis=1)
        self.ids, self.points = ids[inside], points[inside]
        return {"ids": self.ids.tolist(), "uv": uv[inside].tolist()}

    def projected(self, seen):
        scale, centre = (self.camera["fx"], self.camera["fy"]), (self.camera["cx"], self.camera["cy"])
        return seen[:, :2] / seen[:, 2:] * scale + centre

    def distorted(self, uv):
        """OpenCV's model with k1, k2, p1, p2, as far as the settings file has it."""
        scale, centre = (self.camera["fx"], self.camera["fy"]), (self.camera["cx"], self.camera["cy"])
        k1, k2, p1, p2 = [*self.camera.get("distortion", ()), 0.0, 0.0, 0.0, 0.0][:4]
        x, y = ((uv - centre) / scale).T
        r2 = x * x + y * y
        radial = 1 + k1 * r2 + k2 * r2 * r2
        bent = [
            radial * x + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            radial * y + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ]
        return np.column_stack(bent) * scale + centre


def mutual(a, b, within):
    """Indices of those of `a` and `b` that are nearest to each other, within a distance for each of `a` (N,)."""
    if not len(a) or not len(b):
        return np.zeros(0, int), np.zeros(0, int)
    squares = (a**2).sum(1)[:, None] - 2 * a @ b.T + (b**2).sum(1)
    of_a = squares.argmin(axis=1)
    place = np.flatnonzero(squares.argmin(axis=0)[of_a] == np.arange(len(a)))
    near = np.linalg.norm(a[place] - b[of_a[place]], axis=1) <= within[place]
    return place[near], of_a[place[near]]


class OrbSlam3:
    """The system with its vocabulary, from the start request on."""

    def __init__(self, options, rig):
        import pyorbslam3

        self.states, self.monocular = pyorbslam3.TrackingState, options.monocular
        self.camera = "video" if options.monocular else "left"
        with tempfile.TemporaryDirectory() as folder:
            settings = Path(folder) / "settings.yaml"
            settings.write_text(settings_text(rig, options.monocular, options.features), encoding="ascii")
            sensor = pyorbslam3.Sensor.MONOCULAR if options.monocular else pyorbslam3.Sensor.STEREO
            self.slam = pyorbslam3.Slam(options.vocabulary or pyorbslam3.vocabulary_path(), settings, sensor)
        self.tracks = Tracks(rig[self.camera])

    def step(self, time_s, images):
        """The answer about a frame; `images` by camera."""
        if self.monocular:
            result = self.slam.track_monocular(images["video"], time_s)
        else:
            result = self.slam.track_stereo(images["left"], images["right"], time_s)
        state, status = result.state, "lost"
        if state in {self.states.OK, self.states.OK_KLT}:
            status = "tracking"
        elif state not in {self.states.LOST, self.states.RECENTLY_LOST}:
            status = "initialising"
        tracked = int(result.num_tracked_points)
        keypoints = np.asarray(self.slam.tracked_keypoints(), float).reshape(-1, 2)
        answer = {"status": status, "pose": None, "tracks": {}}
        answer["checks"] = [
            {"key": "tracked_points", "value": tracked, "threshold": MIN_TRACKED},
            {"key": "map_changed", "value": int(self.slam.map_changed()), "threshold": 1},
            {"key": "tracking_state", "value": int(state), "threshold": int(self.states.OK), "consequence": state.name},
            {"key": "keypoints", "value": len(keypoints), "threshold": MIN_TRACKED},
        ]
        if status != "tracking":
            self.tracks.end()
        else:
            pose, points = np.asarray(result.pose_wc, float), np.asarray(self.slam.tracked_map_points(), float)
            xyzw = quaternion_xyzw(pose[:3, :3]).tolist()
            answer["pose"] = {"translation": pose[:3, 3].tolist(), "rotation_xyzw": xyzw}
            camera_from_world = np.asarray(result.pose_cw, float)
            answer["tracks"] = {self.camera: self.tracks.answer(points.reshape(-1, 3), keypoints, camera_from_world)}
        return answer


def image_of(listed, content):
    """An image (H, W) as the request describes it."""
    return np.frombuffer(content, np.uint8).reshape(listed["height"], listed["width"])


def serve(options, requests, answers):
    """Answers requests until there are no more."""
    system = None
    while line := requests.readline():
        request = json.loads(line)
        try:
            if request["type"] == "hello":
                unit, frame = ("own", "video") if options.monocular else ("metric", "left")
                answer = {"version": 1, "saves": False, "frame": frame, "unit": unit, "grey": True, "checks": CHECKS}
                answer["source"] = "Campos et al. 2021, ORB-SLAM3, by pyorbslam3"
            elif request["type"] == "start":
                answer, system = {}, OrbSlam3(options, request["rig"])
            else:
                images = {i["camera"]: image_of(i, requests.read(i["bytes"])) for i in request["images"]}
                answer = system.step(request["time_ns"] / 1e9, images)
        except (RuntimeError, ValueError, OSError, ImportError, KeyError) as error:
            answer = {"error": " ".join(f"{type(error).__name__}: {error}".split())[:180]}
        answers.write(json.dumps(answer).encode() + b"\n")
        answers.flush()


def main():
    parser = argparse.ArgumentParser(description="ORB-SLAM3 as an external program of ISPOM")
    parser.add_argument("--vocabulary", help="default: that of pyorbslam3, which it downloads once")
    parser.add_argument("--monocular", action="store_true", help="the video camera instead of the stereo pair")
    parser.add_argument("--features", type=int, default=2000, help="ORB features per image")
    options = parser.parse_args()
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what ORB-SLAM3 prints is no answer
    serve(options, sys.stdin.buffer, answers)
    answers.flush()
    os._exit(0)  # its threads do not end by themselves


if __name__ == "__main__":
    main()
