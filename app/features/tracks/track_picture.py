"""The picture of a camera with its tracks: a click on it picks the nearest one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError
from ispom.types import Image, Sequence, Tracks, TrackStatus, main_image

from ...engine.inspection.colouring import SCALES, Colouring, palette
from ...engine.inspection.looked import Looked
from ...engine.inspection.point import EpipolarLine, epipolar
from ...presentation import colours
from ...session.review.recorded_tracks import RecordedTracks, RecordedViews
from ...views.viser.drawing import dots, in_view, picture, polyline
from ...views.viser.panels import renderer

render = renderer(__package__)

WIDTH = 640
"""Width of the JPEG; the panel is about half as wide."""


def track_picture(looked: Looked, views: RecordedViews | None = None) -> str:
    """As HTML. `views` has images and tracks of a stored run, where it has a recording."""
    known: dict[str, Any] = {"camera": looked.pictured, "index": looked.index, "image": None, "dots": (), "legend": ()}
    known |= {"moved": None, "pickable": not looked.missing}
    if looked.index is None or (image := _image(looked, views)) is None:
        return render("track_picture.html", **known)
    known |= {"image": picture(image, WIDTH), "height": image.shape[0], "width": image.shape[1]}
    recorded = _recorded(looked, views)
    if recorded is not None:
        known |= {"dots": _grouped(recorded.uv_in(image), recorded.classes, looked.colour_by)}
        known |= {"legend": _legend(looked, recorded.counts)}
    elif looked.seen is not None:
        counts = _counts(looked.seen.tracks)
        known |= {"dots": _dots(looked, looked.seen.tracks), "legend": _legend(looked, counts)}
        if (moved := looked.seen.moved) is not None:
            pink = colours.css(colours.MOVING)
            known["moved"] = (pink, dots(moved.uv))
            known["legend"].append((pink, f"{len(moved)} move by themselves, as one rigid thing"))
    title, scale, picked = _title(looked, recorded), _scale(looked), _picked(looked)
    return render("track_picture.html", **known, title=title, scale=scale, picked=picked, rings=_rings(looked))


def _image(looked: Looked, views: RecordedViews | None) -> Image | None:
    """That of the source, or else the one in the recording."""
    if looked.index is None:
        return None
    found = image_of(looked.sequence, looked.index)
    if found is None and views is not None:
        return views.image(looked.pictured, looked.index)
    return found


def _recorded(looked: Looked, views: RecordedViews | None) -> RecordedTracks | None:
    """The tracks in the picture as the recording has them, where the run has none to look at one by one."""
    if not looked.missing or views is None or looked.index is None:
        return None
    return views.tracks(looked.pictured, looked.index, looked.colour_by)


def image_of(sequence: Sequence, index: int) -> Image | None:
    """The video image or the left one of a frame; None where it cannot be read again."""
    try:
        shown = main_image(sequence[index])
    except InputError:
        return None
    return shown[1] if shown is not None and shown[1].size else None


def line_of(looked: Looked) -> EpipolarLine | None:
    """Of the selected track: in the frame that saw it last, the line of where the first one with a pose saw it."""
    seen = looked.life.seen if looked.life else ()
    views = [(s.world_from_camera, s.uv) for s in seen if s.world_from_camera is not None]
    if looked.life is None or len(views) < 2:
        return None
    (first_pose, first_uv), (last_pose, last_uv) = views[0], views[-1]
    lens = looked.lens(looked.of_track, looked.life.camera)
    return epipolar(lens, first_pose, last_pose, first_uv, last_uv)


def _title(looked: Looked, recorded: RecordedTracks | None) -> str:
    if recorded is not None:
        total, drawn = sum(recorded.counts.values()), len(recorded.uv)
        some = f", {drawn} of them drawn" if drawn < total and looked.colour_by == "state" else ""
        return f"{looked.pictured} image of frame {looked.index}, {total or drawn} tracks{some}, of the recording"
    if looked.missing:
        return f"{looked.pictured} image of frame {looked.index}"
    if looked.seen is None:
        return f"{looked.pictured} image of frame {looked.index}: no tracks"
    method = colours.label(looked.seen.step.method)
    return f"{looked.pictured} image of frame {looked.index}, {len(looked.seen.tracks)} tracks: {method}"


def _scale(looked: Looked) -> str:
    return "" if looked.colour_by == "state" else SCALES[looked.colour_by].title


def _dots(looked: Looked, tracks: Tracks) -> list[tuple[str, str]]:
    """(colour, path) of each group of tracks."""
    if looked.colour_by == "state":
        groups = tracks.status
    else:
        groups = np.where(tracks.status < TrackStatus.LOST, looked.knowledge.bins(tracks, looked.colour_by), -1)
    return _grouped(tracks.uv, groups, looked.colour_by)


def _grouped(uv: NDArray, groups: NDArray, colour_by: Colouring) -> list[tuple[str, str]]:
    """(colour, path) of each group of points (N, 2): `groups` (N,) are states or bins, others are not drawn."""
    if colour_by == "state":
        tints = {int(status): colours.css(colour) for status, colour in colours.TRACK.items()}
    else:
        tints = {i: colours.css(colour) for i, colour in enumerate(palette())}
    return [(tint, dots(uv[groups == i])) for i, tint in tints.items() if (groups == i).any()]


def _counts(tracks: Tracks) -> dict[TrackStatus, int]:
    counts = np.bincount(tracks.status, minlength=len(TrackStatus))
    return {status: int(counts[status]) for status in TrackStatus if counts[status]}


def _legend(looked: Looked, counts: dict[TrackStatus, int]) -> list[tuple[str, str]]:
    """(colour, text) of what is in the picture."""
    if looked.colour_by != "state":
        scale = SCALES[looked.colour_by]
        return [(colours.css(c), text) for c, text in zip(palette(), scale.labels(), strict=True)]
    return [(colours.css(colours.TRACK[s]), f"{count} {s.reason}") for s, count in counts.items()]


def _rings(looked: Looked) -> list[list[float]]:
    """Where several selected tracks are in this picture."""
    selection, seen = looked.selection, looked.seen
    if selection is None or selection.kind != "tracks" or seen is None:
        return []
    return in_view(seen.tracks.uv[np.isin(seen.tracks.ids, selection.tracks)]).tolist()


def _picked(looked: Looked) -> dict[str, Any] | None:
    """The selected track in this picture: its path, where it is, and its epipolar line."""
    life = looked.life
    if life is None or life.camera != looked.pictured:
        return None
    line = line_of(looked) if life.last.index == looked.index else None
    path = np.stack([s.uv for s in life.observations])
    u, v = in_view(path[-1])[0].tolist()
    curve = polyline(line.curve_uv) if line is not None and len(line.curve_uv) > 1 else ""
    return {"path": polyline(path), "u": u, "v": v, "line": curve, "here": life.last.index == looked.index}
