"""A visual compass and odometer as a program of its own: nothing but the standard library, nothing of ISPOM.

The columns of each image are summed up; the shift that fits those of the frame before turns the camera, and how much
is left over moves it forward (Milford, Wyeth and Prasser, RatSLAM, ICRA 2004). `--forget`: it saves no state.
"""

import json
import math
import sys

CHECKS = [
    {"key": "contrast", "name": "spread of the columns", "question": "Located?", "unit": "grey levels"},
    {"key": "difference", "name": "left over", "relation": "<=", "question": "Located?", "unit": "grey levels"},
]
WIDEST_SHIFT = 12


def main(saves):
    camera, settings, state = None, {}, None
    while line := sys.stdin.buffer.readline():
        request = json.loads(line)
        if request["type"] == "hello":
            answer = {"version": 1, "saves": saves, "frame": "video", "unit": "own", "grey": True, "checks": CHECKS}
            answer["source"] = "Milford, Wyeth and Prasser 2004"
        elif request["type"] == "start":
            answer, camera, settings = {}, request["rig"]["video"], request["settings"]
            state = {"columns": None, "heading": 0.0, "x": 0.0, "z": 0.0, "id": 0, "u": None}
        elif request["type"] == "restore":
            answer, state = {}, json.loads(sys.stdin.buffer.read(request["state_bytes"]))
        else:
            image = request["images"][0]
            columns = profile(sys.stdin.buffer.read(image["bytes"]), image["width"], image["height"])
            state, answer = step(state, columns, camera, settings)
        saved = json.dumps(state).encode() if saves and request["type"] == "step" else b""
        if saved:
            answer["state_bytes"] = len(saved)
        sys.stdout.buffer.write(json.dumps(answer).encode() + b"\n" + saved)
        sys.stdout.buffer.flush()


def profile(pixels, width, height):
    """The mean of each column [grey levels]."""
    return [sum(pixels[column::width]) / height for column in range(width)]


def step(state, columns, camera, settings):
    """The state after an image, and the answer about it."""
    spread = max(columns) - min(columns)
    shift, left_over = (0, 0.0) if state["columns"] is None else fit(state["columns"], columns)
    made = [
        {"key": "contrast", "value": spread, "threshold": settings.get("min_contrast", 5.0)},
        {"key": "difference", "value": left_over, "threshold": settings.get("max_difference", 40.0)},
    ]
    if made[0]["value"] < made[0]["threshold"] or made[1]["value"] > made[1]["threshold"]:
        begun = state["columns"] is not None
        return {**state, "columns": None, "u": None}, {"status": "lost" if begun else "initialising", "checks": made}
    heading = state["heading"] - math.atan2(shift, camera["fx"])
    x, z = state["x"] + left_over * math.sin(heading), state["z"] + left_over * math.cos(heading)
    u, track = (None if state["u"] is None else state["u"] + shift), state["id"]
    ended = {} if u is None or 0 <= u < camera["width"] else {str(track): "out_of_image"}
    if u is None or ended:  # a point far ahead, followed until it leaves the image
        u, track = camera["width"] // 2, track + 1
    pose = {"translation": [x, 0.0, z], "rotation_xyzw": [0.0, math.sin(heading / 2), 0.0, math.cos(heading / 2)]}
    tracks = {"video": {"ids": [track], "uv": [[u, camera["cy"]]], "ended": ended}}
    after = {"columns": columns, "heading": heading, "x": x, "z": z, "id": track, "u": u}
    return after, {"status": "tracking", "pose": pose, "tracks": tracks, "checks": made}


def fit(before, now):
    """By how many columns the image moved to the right, and the mean difference that is left."""

    def difference(shift):
        low, high = max(0, shift), len(now) + min(0, shift)
        return sum(abs(now[i] - before[i - shift]) for i in range(low, high)) / (high - low)

    found = min(range(-WIDEST_SHIFT, WIDEST_SHIFT + 1), key=difference)
    return found, difference(found)


if __name__ == "__main__":
    main(saves="--forget" not in sys.argv[1:])
