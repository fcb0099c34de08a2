"""SVO as a program that ISPOM starts: its positions, number of tracked features, and stage, frame by frame.

SVO (Forster et al., ICRA 2014) is under the GPL and stays a process of its own, which talks to ISPOM by the protocol of
external programs (version 1). It is used by the documented functions of the package svo-cpp. That package cannot give
the orientation (its binding of the quaternion fails) nor the features' places: all poses have the orientation of the
first one, and there are no tracks. SVO estimates depths in a thread of its own, so two runs can differ.
"""

import json
import os
import sys

import cv2
import numpy as np

MIN_FEATURES = 50
"""Tracked features below which SVO calls its quality insufficient (Config::qualityMinFts)."""
CHECKS = [
    {"key": "tracked_features", "name": "features tracked", "question": "Tracked?"},
    {"key": "stage", "name": "stage", "kind": "finding"},
]
HELLO = {"version": 1, "saves": False, "frame": "video", "unit": "own", "grey": True, "checks": CHECKS}
HELLO["source"] = "Forster et al. 2014, SVO, by svo-cpp"


class Svo:
    """The pipeline for one camera, from the start request on."""

    def __init__(self, camera):
        import svo_cpp

        self.stages = svo_cpp.Stage
        self.matrix = np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]], float)
        self.distortion = np.array(camera.get("distortion") or [0.0] * 4, float)
        size = float(camera["width"]), float(camera["height"])
        model = svo_cpp.PinholeCamera(*size, *(float(camera[name]) for name in ("fx", "fy", "cx", "cy")))
        self.model = model  # SVO keeps a pointer to it
        self.svo = svo_cpp.SVO(model)
        self.svo.start()

    def step(self, time_s, image):
        """The answer about an image (H, W), which SVO gets without distortion."""
        self.svo.addImage(np.ascontiguousarray(cv2.undistort(image, self.matrix, self.distortion)), time_s)
        stage, tracked = self.svo.stage(), int(self.svo.lastNumObservations())
        status = {self.stages.DEFAULT_FRAME: "tracking", self.stages.RELOCALIZING: "lost"}.get(stage, "initialising")
        answer = {"status": status, "pose": None}
        answer["checks"] = [
            {"key": "tracked_features", "value": tracked, "threshold": MIN_FEATURES},
            {
                "key": "stage",
                "value": int(stage),
                "threshold": int(self.stages.DEFAULT_FRAME),
                "consequence": stage.name,
            },
        ]
        if status == "tracking":
            place = np.asarray(self.svo.lastFrame().T_f_w.inverse().translation(), float).ravel()
            answer["pose"] = {"translation": place.tolist(), "rotation_xyzw": [0.0, 0.0, 0.0, 1.0]}
        return answer


def serve(requests, answers):
    """Answers requests until there are no more."""
    system = None
    while line := requests.readline():
        request = json.loads(line)
        try:
            if request["type"] == "hello":
                answer = HELLO
            elif request["type"] == "start":
                answer, system = {}, Svo(request["rig"]["video"])
            else:
                (listed,) = request["images"]
                image = np.frombuffer(requests.read(listed["bytes"]), np.uint8)
                answer = system.step(request["time_ns"] / 1e9, image.reshape(listed["height"], listed["width"]))
        except (RuntimeError, ValueError, OSError, ImportError, KeyError) as error:
            answer = {"error": " ".join(f"{type(error).__name__}: {error}".split())[:180]}
        answers.write(json.dumps(answer).encode() + b"\n")
        answers.flush()


def main():
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what SVO prints is no answer
    serve(sys.stdin.buffer, answers)
    answers.flush()
    os._exit(0)  # its threads do not end by themselves


if __name__ == "__main__":
    main()
