"""Entities of the recorder: pure functions that convert the library's values to Rerun's.

Rerun's pixel coordinates count from the corner of the top-left pixel, ours from its centre: half a pixel apart.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, replace

import cv2
import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from ispom.geometry import Array, Pose, Similarity
from ispom.types import Camera, FrameName, Image, ImageLines, Rig, Step, Tracks, TrackStatus, WorldLines

from ...engine.frame_record import INLIERS, RESIDUAL
from ...engine.history.quantities import step_number
from ...engine.history.record import MethodStatus
from ...presentation import colours
from ...presentation.decisions import answers, mark, measured, named
from ...presentation.uncertainty import Ellipsoid, describe
from .batch import Entry

JPEG_QUALITY = 80
SHOWN_PX = 640 * 480
"""Larger images are shown, and kept, at about this many pixels."""
MOST_MARKERS = 600
"""Most tracks that are drawn in an image, spread evenly over it: more would hide it. Counts are of all tracks."""
CELLS = (16, 12)
"""Columns and rows of the parts of an image over which the drawn tracks are spread."""
INK: colours.Rgb = (128, 128, 128)
"""Colour of the words in a legend: they can be read in a dark and in a light viewer."""
LEGEND_COLUMNS, LEGEND_ROWS = 3, 4
"""Columns and rows of a legend below its image."""
LEGEND_WIDTH = 0.32
"""Width of a legend next to the image, in widths of the image."""
TRAIL_LENGTH = 10
"""Most earlier positions of a track that its trail shows."""
TRAIL_SHARE = 0.06
"""Longest trail, in widths of the image, so that the image stays visible."""
FADING = ((0, 3, 0.9, 0.5), (3, 6, 0.5, 0.4), (6, 10, 0.3, 0.3))
"""Parts of a trail: first and last place, counted from now, opacity and half width [px]."""
THUMBNAIL_PX = 200
"""Width of the image in a camera's frustum."""


def shown_scale(width: int, height: int) -> float:
    """The factor (<= 1) by which an image is shrunk for display."""
    return min(1.0, (SHOWN_PX / (width * height)) ** 0.5)


def transform(pose: Pose) -> rr.Transform3D:
    """parent_from_entity."""
    return rr.Transform3D(translation=pose.translation, mat3x3=pose.rotation)


def placement(parent_from_entity: Similarity) -> rr.Transform3D:
    """parent_from_entity, with its change of unit."""
    pose = parent_from_entity.pose
    return rr.Transform3D(translation=pose.translation, mat3x3=parent_from_entity.scale * pose.rotation)


def jpeg(image: Image) -> rr.EncodedImage:
    """The image, at `shown_scale`."""
    return rr.EncodedImage(contents=jpeg_bytes(image, JPEG_QUALITY), media_type="image/jpeg")


def jpeg_bytes(image: Image, quality: int) -> bytes:
    """Returns the content of a JPEG file of the image at `shown_scale`. `quality` is from 1 to 100."""
    scale = shown_scale(image.shape[1], image.shape[0])
    if scale < 1:
        size = (round(image.shape[1] * scale), round(image.shape[0] * scale))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
    bgr = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return data.tobytes()


def shown_uv(uv: NDArray, camera: Camera) -> NDArray[np.float32]:
    """Rerun's coordinates (..., 2) on the shown image of our pixels (..., 2)."""
    return ((np.asarray(uv) + 0.5) * shown_scale(camera.width, camera.height)).astype(np.float32)


def strips(places: NDArray[np.float32]) -> pa.Array:
    """Returns polylines (N, K, 2 or 3) in Rerun's storage format. This is faster: Rerun would convert each number."""
    count, length, dimension = places.shape
    kind = _STRIPS[dimension]
    flat = pa.array(np.ascontiguousarray(places, np.float32).reshape(-1))
    inner = pa.FixedSizeListArray.from_arrays(flat, type=kind.value_type)
    return pa.ListArray.from_arrays(pa.array(np.arange(count + 1, dtype=np.int32) * length), inner, type=kind)


def lines(places: list[Array] | Array, colour: colours.Rgb, width_px: float) -> rr.LineStrips3D:
    """Polylines (N, K, 3), or some of different lengths. Negative radii are screen units in Rerun."""
    equal_lengths = len({len(some) for some in places}) <= 1
    drawn = (
        strips(np.asarray(places, np.float32)) if equal_lengths else [np.asarray(some, np.float32) for some in places]
    )
    return rr.LineStrips3D(drawn, colors=colours.packed(colour), radii=[-width_px])


NAME_STEP = np.array([0.0, -1.5, 1.5])
"""Offset of a name from the end of its path, in the shared world and in depths of a camera. Names of paths that end
together have half of this distance. It is oblique, so that names are separate from above and from the side."""


def name(text: str, place: Array, colour: colours.Rgb) -> rr.Points3D:
    """Returns the name of a line, at a position (3,) next to its end."""
    return rr.Points3D([place], labels=[text], colors=colours.packed(colour), radii=[0.0], show_labels=True)


LINE_PX = 1.0
"""Half width [px] on the screen of lines that a method found."""
MOVING = len(TrackStatus)
"""Class id of tracks on objects that move by themselves."""


def statuses() -> rr.AnnotationContext:
    """Returns the meaning of the class ids of `points` and `moving`, which the viewer shows on hovering."""
    known = [(int(s), s.reason, colours.TRACK[s]) for s in TrackStatus]
    return rr.AnnotationContext([*known, (MOVING, "moves by itself, with others as one rigid thing", colours.MOVING)])


def thinned(tracks: Tracks, camera: Camera) -> Tracks:
    """Returns at most MOST_MARKERS tracks: the same number in each part of the image, as far as it has enough. In each
    part these are the oldest tracks, so that the same ones are drawn from frame to frame."""
    if len(tracks) <= MOST_MARKERS:
        return tracks
    places = np.nan_to_num(tracks.uv) / [camera.width, camera.height]
    cell = np.clip(places * CELLS, 0, np.array(CELLS) - 1).astype(int)
    parts = cell[:, 0] * CELLS[1] + cell[:, 1]
    order = np.lexsort([tracks.ids, parts])
    first = np.r_[True, np.diff(parts[order]) > 0]
    rank = np.arange(len(order)) - np.flatnonzero(first)[np.cumsum(first) - 1]
    selected = np.sort(order[np.argsort(rank, kind="stable")[:MOST_MARKERS]])
    return Tracks(*(getattr(tracks, field.name)[selected] for field in fields(Tracks)))


def points(tracks: Tracks, camera: Camera) -> rr.Points2D:
    """Returns the tracks at their present or last positions; their class is their status."""
    radii = np.where(tracks.status >= TrackStatus.LOST, np.float32(-2.0), np.float32(-1.5))
    return rr.Points2D(
        shown_uv(tracks.uv, camera), class_ids=tracks.status.astype(np.uint16), radii=radii, show_labels=False
    )


def moving(tracks: Tracks, camera: Camera) -> rr.Points2D:
    """Returns the tracks that one other rigid motion explains, a little larger than `points`."""
    classes = np.full(len(tracks), MOVING, np.uint16)
    return rr.Points2D(shown_uv(tracks.uv, camera), class_ids=classes, radii=[-2.5], show_labels=False)


def trails(recent: list[Tracks], camera: Camera) -> rr.LineStrips2D:
    """Returns the last positions of the live tracks as lines that fade with age. `recent` are this camera's Tracks,
    oldest first."""
    now = recent[-1]
    living = (now.status < TrackStatus.LOST) & ~np.isnan(now.uv_prev[:, 0])
    places, lengths = [now.uv[living]], np.zeros(int(living.sum()))
    for earlier in reversed(recent[:-1]):
        order = np.argsort(earlier.ids)
        at = np.minimum(np.searchsorted(earlier.ids, now.ids[living], sorter=order), max(len(earlier) - 1, 0))
        rows = order[at] if len(order) else at[:0]
        if not len(rows):
            break
        lengths = lengths + np.linalg.norm(earlier.uv[rows] - places[-1], axis=1)
        shown = (earlier.ids[rows] == now.ids[living]) & (lengths <= TRAIL_SHARE * camera.width)
        lengths[~shown] = np.inf
        places.append(np.where(shown[:, None], earlier.uv[rows], places[-1]))
    if len(places) == 1:
        places.append(now.uv_prev[living])
    uv = shown_uv(np.stack(places, 1), camera)
    parts = [uv[:, first : last + 1] for first, last, _, _ in FADING if first < len(places) - 1]
    parts = [part[(part[:, 0] != part[:, -1]).any(1)] if i else part for i, part in enumerate(parts)]
    counts = [len(part) for part in parts]
    _, _, opacity, radius = np.array(FADING[: len(parts)]).T
    r, g, b = colours.TRAIL
    rgba = [[r, g, b, round(255 * alpha)] for alpha in opacity]
    return rr.LineStrips2D(
        pa.concat_arrays([strips(part) for part in parts]),
        colors=np.repeat(np.array(rgba, np.uint8), counts, axis=0),
        radii=-np.repeat(radius, counts),
    )


def thumbnail(image: Image) -> rr.EncodedImage:
    """A small copy, for the frustum of a camera in the 3-D view."""
    scale = min(1.0, THUMBNAIL_PX / image.shape[1])
    size = (max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale)))
    return jpeg(cv2.resize(image, size, interpolation=cv2.INTER_AREA))  # type: ignore[arg-type]


def pinhole(camera: Camera, depth: float) -> rr.Pinhole:
    """Returns the pinhole of a `thumbnail` at a depth. It has no outline, because the camera is drawn with one."""
    scale = min(1.0, THUMBNAIL_PX / camera.width)
    width, height = max(1, round(camera.width * scale)), max(1, round(camera.height * scale))
    return rr.Pinhole(
        resolution=[width, height],
        focal_length=[camera.fx * scale, camera.fy * scale],
        principal_point=[(camera.cx + 0.5) * scale, (camera.cy + 0.5) * scale],
        image_plane_distance=depth,
        line_width=0.0,
    )


def disparities(tracks: Tracks, camera: Camera) -> rr.LineStrips2D:
    """Returns a line from each point to its position in the right image: the longer, the nearer."""
    known = ~np.isnan(tracks.disparity_px) & (tracks.status < TrackStatus.LOST)
    right = tracks.uv[known] - np.stack([tracks.disparity_px[known], np.zeros(known.sum())], 1)
    drawn = strips(shown_uv(np.stack([tracks.uv[known], right], 1), camera))
    return rr.LineStrips2D(drawn, colors=colours.packed(colours.DISPARITY), radii=[-0.4])


def image_lines(found: ImageLines, camera: Camera) -> rr.LineStrips2D:
    """Lines on an image, in the colours of their groups."""
    drawn = strips(shown_uv(found.uv, camera))
    return rr.LineStrips2D(drawn, colors=colours.of_groups(found.group), radii=[-LINE_PX])


def world_lines(found: WorldLines) -> rr.LineStrips3D:
    """Lines of the scene, in the colours of their groups."""
    drawn = strips(np.asarray(found.xyz_in_world, np.float32))
    return rr.LineStrips3D(drawn, colors=colours.of_groups(found.group), radii=[-LINE_PX])


def in_right(tracks: Tracks) -> Tracks:
    """Returns the tracks of the left image that have a disparity, at their positions in the right image."""
    known = np.flatnonzero(~np.isnan(tracks.disparity_px) & (tracks.status < TrackStatus.LOST))
    found = Tracks(*(getattr(tracks, field.name)[known] for field in fields(Tracks)))
    shift = np.stack([found.disparity_px, np.zeros(len(known))], 1)
    return replace(found, uv=(found.uv - shift).astype(found.uv.dtype))


def legend(path: str, tracks: Tracks, moved: Tracks | None, camera: Camera) -> Iterator[Entry]:
    """Yields the legend next to or below the image: for each status its colour and the number of tracks, and the number
    of tracks that move by themselves."""
    counts = np.bincount(tracks.status, minlength=len(TrackStatus))
    items = [(int(s), f"{counts[s]} {status_text(s)}") for s in TrackStatus if counts[s]]
    if moved is not None:
        items.append((MOVING, f"{len(moved)} move alone"))
    yield from legend_entries(
        path, [number for number, _ in items], [text for _, text in items], legend_places(len(items), camera)
    )


def legend_entries(
    path: str, class_ids: list[int], labels: list[str], places: Array, *, static: bool = False
) -> Iterator[Entry]:
    """Yields dots in the colours of the classes, and the words as separate dots in INK, because the viewer writes words
    in the colour of their dots."""
    dots = rr.Points2D(places, class_ids=class_ids, labels=labels, radii=-4.0, show_labels=False)
    yield Entry(path, dots, static)
    words = rr.Points2D(places, colors=[INK] * len(labels), labels=labels, radii=0.0, show_labels=True)
    yield Entry(f"{path}/words", words, static)


def legend_places(count: int, camera: Camera, row_height: float = 0.13) -> Array:
    """Returns positions (count, 2) in Rerun's coordinates: rows of LEGEND_COLUMNS below a wide image, or else a column
    next to it, whose rows have the distance `row_height` in heights of the image."""
    size, places = np.array([camera.width, camera.height]), np.arange(count)
    if _legend_below(camera):
        row, column = np.divmod(places, LEGEND_COLUMNS)
        at = np.stack([(column + 0.5) / LEGEND_COLUMNS, 1 + 0.085 * camera.width / camera.height * (row + 0.3)], 1)
    else:
        at = np.stack([np.full(count, 1 + LEGEND_WIDTH / 2), 0.03 + row_height * places], 1)
    return at * size * shown_scale(camera.width, camera.height)


def image_size(camera: Camera) -> Array:
    """Width and height (2,) of the shown image in Rerun's coordinates."""
    return np.array([camera.width, camera.height]) * shown_scale(camera.width, camera.height)


def shown_size(camera: Camera) -> Array:
    """Width and height (2,), in Rerun's coordinates, of the shown image with its legend."""
    width, height = camera.width, camera.height
    size = (
        [width, height + LEGEND_ROWS * 0.085 * width] if _legend_below(camera) else [(1 + LEGEND_WIDTH) * width, height]
    )
    return np.array(size) * shown_scale(width, height)


def _legend_below(camera: Camera) -> bool:
    """Returns whether the legend is below the image. Labels have a constant size on the screen, so a legend takes the
    room that the shape of the image leaves."""
    return camera.width > camera.height


_STRIPS = {
    2: rr.components.LineStrip2DBatch(np.zeros((1, 2, 2), np.float32)).as_arrow_array().type,
    3: rr.components.LineStrip3DBatch(np.zeros((1, 2, 3), np.float32)).as_arrow_array().type,
}
_SHORT = {
    TrackStatus.LOST: "not found",
    TrackStatus.FORWARD_BACKWARD: "failed back-check",
    TrackStatus.OUT_OF_IMAGE: "out of the image",
    TrackStatus.NO_DISPARITY: "no disparity",
}


def status_text(status: TrackStatus) -> str:
    """A status in a legend."""
    return _SHORT.get(status, status.name.lower())


def frustum(camera: Camera, frame_from_camera: Pose, depth: float) -> Array:
    """Returns one polyline (10, 3) in the frame: the outline of the camera's view up to a depth."""
    w, h = camera.width - 0.5, camera.height - 0.5
    rays = camera.normalise(np.array([[-0.5, -0.5], [w, -0.5], [w, h], [-0.5, h]]))
    top_left, top_right, bottom_right, bottom_left = np.column_stack([rays, np.ones(4)]) * depth
    centre = np.zeros(3)
    strip = [top_right, top_left, centre, top_right, bottom_right, centre, bottom_left, bottom_right, bottom_left]
    return frame_from_camera.apply(np.stack([*strip, top_left]))


def outlines(rig: Rig, frame: FrameName, size: float, main_camera: bool) -> Array:
    """Returns frusta (L, 10, 3) in a frame: of the video camera (without one: the left one), or of both stereo cameras.
    For a rig without these, they are of all cameras."""
    main: FrameName = "video" if rig.video is not None else "left"
    names: tuple[FrameName, ...] = (main,) if main_camera or not rig.has_stereo else ("left", "right")
    if rig.video is None and rig.left is None:
        names = tuple(rig.cameras)
    frame_from_rig = rig.rig_from(frame).inverse()
    return np.stack([frustum(rig.camera(n), frame_from_rig @ rig.rig_from(n), size) for n in names])


def ellipsoid(found: Ellipsoid, colour: colours.Rgb) -> rr.Ellipsoids3D:
    """Returns the ellipsoid in the world of the pose, as a few lines. A filled one that is larger than the scene would
    tint all of it."""
    return rr.Ellipsoids3D(
        half_sizes=[found.half_sizes],
        centers=[found.centre],
        quaternions=[found.pose.xyzw],
        colors=colours.packed(colour),
        line_radii=[-0.75],
        fill_mode="majorwireframe",
    )


def summary(steps: dict[str, Step], first_ns: int, units_m: Mapping[str, float | None]) -> str:
    """Returns Markdown with the decisions of each method in its latest step, and the reasons. `units_m`: the methods'
    units [m], None where unknown."""
    return "\n".join(part for step in steps.values() for part in _story(step, first_ns, units_m))


def _story(step: Step, first_ns: int, units_m: Mapping[str, float | None]) -> Iterator[str]:
    facts = [
        f"**{colours.label(step.method)}**",
        f"{(step.time_ns - first_ns) * 1e-9:.3f} s",
        f"**{MethodStatus.of(step, None).word}**",
    ]
    facts += ["keyframe"] * step.key_frame + ["no pose"] * (step.world_from_frame is None)
    inliers, median = step_number(step, INLIERS.key), step_number(step, RESIDUAL.key)
    if inliers is not None and median is not None:
        facts.append(f"{inliers:.0f} inliers, median {median:.2f} px")
    facts += [text] if (text := describe(step, units_m.get(step.method, 1.0))) else []
    yield from (" · ".join(facts), "")
    for answer in answers(step.decisions):
        if answer.question:
            yield from (_plain(f"{answer.question} {answer.text}"), "")
        for d in answer.checks:
            consequence = f" → {d.consequence}" if d.consequence else ""
            yield f"- {mark(d)} {_plain(f'{named(d)}: {measured(d)}{consequence}')}"
        yield ""


def _plain(text: str) -> str:
    """As it is, in Markdown."""
    return re.sub(r"([\\`*_{}\[\]<>#|])", r"\\\1", text)
