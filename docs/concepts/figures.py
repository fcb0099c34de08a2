"""Draws the figures of the concepts as SVG: `python docs/concepts/figures.py`. A test compares them with the files."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

HERE = Path(__file__).parent
GREY, BLUE, GREEN, RED, ORANGE = "#888888", "#0072b2", "#009e73", "#d55e00", "#e69f00"


def svg(width: int, height: int, parts: Iterable[str]) -> str:
    """Returns an SVG image whose texts are readable on light and dark pages."""
    body = "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'font-family="sans-serif" font-size="13">\n<rect width="{width}" height="{height}" fill="white" rx="6"/>\n'
        f"{body}\n</svg>\n"
    )


def line(x1: float, y1: float, x2: float, y2: float, colour: str = GREY, width: float = 1.5, dash: str = "") -> str:
    dashed = f' stroke-dasharray="{dash}"' if dash else ""
    ends = f'x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
    return f'<line {ends} stroke="{colour}" stroke-width="{width}"{dashed}/>'


def path(points: Iterable[tuple[float, float]], colour: str, width: float = 2.0, dash: str = "") -> str:
    dashed = f' stroke-dasharray="{dash}"' if dash else ""
    where = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline points="{where}" fill="none" stroke="{colour}" stroke-width="{width}"{dashed}/>'


def dot(x: float, y: float, colour: str, radius: float = 4) -> str:
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius}" fill="{colour}"/>'


def words(x: float, y: float, text: str, colour: str = "#222222", anchor: str = "start") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="{colour}" text-anchor="{anchor}">{text}</text>'


def times() -> str:
    """Two clocks: video frames and stereo frames on one axis."""
    parts = [words(20, 40, "video, 30 Hz"), words(20, 85, "stereo, 3 Hz"), line(130, 110, 600, 110)]
    for i in range(29):
        x = 140 + 16 * i
        parts.append(line(x, 26, x, 46, BLUE, 2))
        if i % 10 == 0:
            parts.append(line(x, 71, x, 91, GREEN, 4))
            parts.append(line(x, 91, x, 110, GREY, 1, "3 3"))
            parts.append(words(x, 128, f"{i // 10}/3 s", anchor="middle"))
    return svg(620, 140, parts)


def scale() -> str:
    """Two cameras and points, at two scales: the images are the same."""
    parts = []
    for factor, colour in ((1.0, BLUE), (1.7, RED)):
        left, right = (60.0, 190.0), (60 + 110 * factor, 190.0)
        points = [(60 + dx * factor, 190 - dy * factor) for dx, dy in ((20, 70), (60, 85), (100, 65))]
        for x, y in points:
            parts += [line(*left, x, y, colour, 1), line(*right, x, y, colour, 1), dot(x, y, colour)]
        parts += [dot(*left, colour, 6), dot(*right, colour, 6)]
    parts += [words(300, 60, "Both scenes give the same images:"), words(300, 80, "every ray has the same direction.")]
    parts += [words(300, 110, "small scene, short baseline", BLUE), words(300, 130, "large scene, long baseline", RED)]
    return svg(580, 215, parts)


def covariance() -> str:
    """Growth of the standard deviation along a path, and errors inside its 95 % band."""
    xs = range(0, 401, 8)
    sigma = [4 + 0.022 * x**1.25 for x in xs]
    error = [s * (0.9 * math.sin(0.021 * x + 1) + 0.45 * math.sin(0.083 * x)) for x, s in zip(xs, sigma, strict=True)]
    parts = [line(50, 110, 470, 110)]
    for sign in (1, -1):
        parts.append(path([(50 + x, 110 + sign * 1.96 * s) for x, s in zip(xs, sigma, strict=True)], GREEN, 1.5, "5 4"))
    parts.append(path([(50 + x, 110 + e) for x, e in zip(xs, error, strict=True)], BLUE))
    parts += [words(480, 50, "95 % band", GREEN), words(480, 115, "error", BLUE), words(50, 210, "time")]
    return svg(560, 225, parts)


def rows() -> str:
    """A rolling shutter: rows of an image are exposed one after the other while the camera moves."""
    parts = [words(40, 30, "global shutter"), words(300, 30, "rolling shutter")]
    for i in range(9):
        y = 50 + 14 * i
        parts.append(line(40, y, 200, y, "#cccccc", 1))
        parts.append(line(300, y, 460, y, "#cccccc", 1))
        parts.append(dot(120, y, BLUE))
        parts.append(dot(352 + 7 * i, y, RED))
    parts += [words(40, 195, "A vertical edge stays vertical."), words(300, 195, "It leans: each row is later.")]
    return svg(520, 215, parts)


def loop() -> str:
    """A path that comes back: with odometry alone it stays open; a loop closes it."""
    angles = [2 * math.pi * i / 60 for i in range(61)]
    truth = [(150 + 100 * math.cos(a), 120 + 80 * math.sin(a)) for a in angles]
    drift = [(x + 0.55 * i, y - 0.35 * i) for i, (x, y) in enumerate(truth)]
    parts = [path(truth, GREY, 3), path(drift, RED), dot(*truth[0], GREY, 5), dot(*drift[-1], RED, 5)]
    parts += [line(*drift[-1], *truth[0], GREEN, 2, "4 3"), words(310, 90, "odometry drifts", RED)]
    parts += [
        words(310, 115, "a loop measures this gap,", GREEN),
        words(310, 135, "and a pose graph spreads it", GREEN),
    ]
    parts += [words(310, 160, "ground truth", GREY)]
    return svg(520, 225, parts)


def fork() -> str:
    """States along a run, and a branch with another setting from one of them."""
    parts = []
    for i in range(8):
        x = 50 + 60 * i
        if i:
            parts.append(line(x - 60, 60, x, 60, BLUE, 2))
        parts += [dot(x, 60, BLUE, 6), words(x, 42, f"s{i}", anchor="middle")]
        if i >= 4:
            parts += [line(x - 60, 60 if i == 4 else 130, x, 130, ORANGE, 2), dot(x, 130, ORANGE, 6)]
    parts += [words(50, 90, "s(i+1) = step(s(i), frame)", BLUE)]
    parts += [words(50, 135, "fork at frame 3: other setting", ORANGE)]
    return svg(520, 160, parts)


def keyframes() -> str:
    """Frames along a path; a keyframe where the view has changed enough, and the window of the newest ones."""
    parts = ['<rect x="330" y="30" width="210" height="90" fill="#eef6ff" stroke="#0072b2" stroke-dasharray="4 3"/>']
    for i in range(25):
        x, y = 40 + 20 * i, 85 - 18 * math.sin(0.22 * i)
        key = i % 5 == 0
        parts.append(dot(x, y, BLUE if key else "#bbbbbb", 7 if key else 3))
    parts += [words(40, 140, "keyframes: optimised, hold the points", BLUE), words(345, 48, "window", BLUE)]
    parts += [words(40, 30, "older keyframes: a prior", GREY)]
    return svg(560, 155, parts)


def layers() -> str:
    """The parts of the library and of the app; imports go down only."""
    parts = []
    levels = (
        (ORANGE, ("cli",)),
        (ORANGE, ("features", "views")),
        (ORANGE, ("session",)),
        (ORANGE, ("engine", "presentation")),
        (BLUE, ("calibration", "testing")),
        (BLUE, ("methods, ensemble",)),
        (BLUE, ("estimators: modern, paper, survey",)),
        (BLUE, ("features", "sequences", "simulation", "evaluation")),
        (BLUE, ("solvers", "io", "numerics")),
        (BLUE, ("cameras", "types", "settings", "geometry")),
    )
    for i, (colour, names) in enumerate(levels):
        width = 560 / len(names)
        for k, name in enumerate(names):
            x, y = 90 + k * width, 14 + 34 * i + (12 if colour == BLUE else 0)
            place = f'x="{x + 2:.1f}" y="{y}" width="{width - 4:.1f}" height="28" rx="4"'
            parts.append(f'<rect {place} fill="none" stroke="{colour}"/>')
            parts.append(words(x + width / 2, y + 19, name, anchor="middle"))
    parts += [words(16, 80, "app", ORANGE), words(16, 240, "ispom", BLUE)]
    return svg(670, 374, parts)


def camera(x: float, y: float, name: str, colour: str) -> list[str]:
    """A camera as a triangle that opens upwards, with its name below."""
    return [path([(x, y), (x - 12, y - 20), (x + 12, y - 20), (x, y)], colour), words(x, y + 18, name, anchor="middle")]


def triple() -> str:
    """Three keyframes on a bend: the printed length of the second step is too short."""
    places = [(80.0, 150.0), (220.0, 120.0), (340.0, 160.0)]
    points = [(140, 30), (200, 22), (250, 34)]
    parts = [line(*place, *point, "#cccccc", 1) for place in places for point in points]
    parts += [dot(*point, GREY) for point in points]
    for place, name in zip(places, ("C1", "C2", "C3"), strict=True):
        parts += camera(*place, name, BLUE)
    parts += [line(*places[0], *places[1], GREEN, 2.5), line(*places[1], *places[2], GREEN, 2.5)]
    parts += [line(*places[0], *places[2], RED, 2, "5 4"), words(135, 127, "T12", GREEN), words(285, 133, "T23", GREEN)]
    parts += [
        words(205, 175, "T13", RED),
        words(400, 70, "As vectors: T12 + T23 = T13."),
        words(400, 95, "As printed:"),
    ]
    parts += [words(400, 115, "|T23| = |T13| - |T12|,"), words(400, 140, "which is too short on every bend", RED)]
    return svg(620, 200, parts)


def clouds() -> str:
    """Two pairs, a cloud of points from each, and the rigid motion between them."""
    cloud = [(0, 0), (34, -22), (60, 8), (88, -14), (24, 26), (70, 34)]
    parts = []
    for x, y in cloud:
        a, b = (80 + x, 60 + y), (330 + 0.95 * x - 0.3 * y, 55 + 0.3 * x + 0.95 * y)
        parts += [line(*a, *b, "#dddddd", 1), dot(*a, BLUE), dot(*b, GREEN)]
    for x, colour, name in ((100, BLUE, "pair i - 1"), (350, GREEN, "pair i")):
        parts += [*camera(x, 160, "", colour), *camera(x + 36, 160, "", colour)]
        parts.append(words(x + 18, 180, name, colour, "middle"))
    parts.append(words(238, 150, "R, T", anchor="middle"))
    return svg(520, 195, parts)


def segment() -> str:
    """A segment of the video between two stereo poses: scaled and rotated so that both ends fit."""
    own = [(60 + 9 * i, 150 - 14 * math.sin(0.5 * i)) for i in range(13)]
    (ax, ay), (bx, by) = (300.0, 150.0), (500.0, 100.0)
    factor = math.hypot(bx - ax, by - ay) / math.hypot(own[-1][0] - own[0][0], own[-1][1] - own[0][1])
    turn = math.atan2(by - ay, bx - ax) - math.atan2(own[-1][1] - own[0][1], own[-1][0] - own[0][0])
    c, s = factor * math.cos(turn), factor * math.sin(turn)
    shifted = [(x - own[0][0], y - own[0][1]) for x, y in own]
    fitted = [(ax + c * x - s * y, ay + s * x + c * y) for x, y in shifted]
    parts = [path(own, BLUE), path(fitted, ORANGE), dot(ax, ay, GREEN, 7), dot(bx, by, GREEN, 7)]
    parts += [words(60, 185, "video, unit of its own", BLUE), words(300, 185, "scaled and rotated", ORANGE)]
    parts += [
        words(512, 104, "C(j+1)", GREEN),
        words(264, 146, "C(j)", GREEN),
        words(440, 60, "stereo poses, metres", GREEN),
    ]
    return svg(600, 205, parts)


def both_images() -> str:
    """A point is predicted, found in both images of a pair, and its reprojection errors give the pose."""
    parts = []
    for x, name in ((40, "left"), (300, "right")):
        parts.append(f'<rect x="{x}" y="30" width="200" height="120" fill="none" stroke="{GREY}"/>')
        parts.append(words(x, 22, name))
    for u, v, disparity in ((60, 40, 30), (120, 80, 14), (150, 35, 8), (90, 100, 40)):
        for x, shift in ((40, 0), (300, disparity)):
            at, predicted = (x + u - shift, 30 + v), (x + u - shift + 9, 30 + v - 6)
            parts += [line(*at, *predicted, RED, 1.5), dot(*at, BLUE), dot(*predicted, ORANGE, 3)]
    parts += [words(40, 172, "measured", BLUE), words(120, 172, "predicted from the map", ORANGE)]
    parts.append(words(300, 172, "their differences give the pose", RED))
    return svg(540, 188, parts)


def spline() -> str:
    """One spline through time, seen by pairs and by video frames."""
    curve = [(40 + x, 90 - 28 * math.sin(0.016 * x) - 10 * math.sin(0.047 * x)) for x in range(0, 461, 4)]
    parts = [path(curve, ORANGE, 2.5)]
    for k, (x, y) in enumerate(curve):
        if k % 4 == 0:
            parts.append(line(x, y, x, y + 14, BLUE, 1.5))
        if k % 38 == 0:
            parts += [line(x, y - 22, x, y, GREEN, 4), dot(x, y, GREEN, 5)]
    parts += [words(40, 150, "video frames give the shape", BLUE), words(250, 150, "pairs give the scale", GREEN)]
    parts.append(words(400, 150, "one cumulative B-spline", ORANGE))
    return svg(570, 165, parts)


FIGURES = {
    "times": times,
    "scale": scale,
    "covariance": covariance,
    "rows": rows,
    "loop": loop,
    "fork": fork,
    "keyframes": keyframes,
    "../developers/layers": layers,
    "../methods/triple": triple,
    "../methods/clouds": clouds,
    "../methods/segment": segment,
    "../methods/both_images": both_images,
    "../methods/spline": spline,
}

if __name__ == "__main__":
    for name, draw in FIGURES.items():
        (HERE / f"{name}.svg").write_text(draw(), encoding="utf-8")
