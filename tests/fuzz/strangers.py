"""Folders that somebody else hands over: lessons, what a killed run left, kept calibrations, scenarios, plans, runs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from ispom_app.features.bookmarks.notes import notes_of, read_notes
from ispom_app.features.calibration.kept import NUMBERS, REPORT, RIG, files_of, kept_in
from ispom_app.features.experiments.options import Experiment
from ispom_app.features.experiments.plan_file import read_plan
from ispom_app.features.lessons.library import own_lesson
from ispom_app.features.lessons.page_message import html
from ispom_app.features.recording.listing import list_recordings
from ispom_app.features.recording.state import Recordings
from ispom_app.session.sources.opening import stored_at
from ispom_app.session.state import State
from ispom_app.views.rerun.repair import unfinished
from ispom_app.views.web.messages import message_of

from ispom.io.rig import rig_text
from ispom.sequences import open_sequence
from tests import doubles
from tests.app import helpers
from tests.app.learn.test_lesson_file import LESSON
from tests.app.strangers import complete_run, killed_run
from tests.fuzz.corpus import Item

SCENARIO = """scene: tiny
seed: 3
route: {case}/walk.tum
mesh: {case}/room.obj
duration_s: 0.3
width_px: 64
faults:
  - darkness: {{factor: 0.5, from_s: 0.1}}
  - clock: {{late_s: 0.01}}
"""
PLAN = """title: A plan
sources: [sim:tiny]
seeds: 0-2
methods: [stereo]
settings:
  stereo.max_tracks: [100, 200]
quantities: [ate_m]
statements:
  - {text: said, quantity: ate_m, line: "stereo, max_tracks 100", at_most: 1.0}
"""
DRIVE = """source: a
sequence: a
notes: []
options: {}
config: {}
versions: {}
exposures: {video: 3}
duration_s: 1.5
"""
NOTES = "note: seen\nbookmarks:\n- {exposure: 1, time_ns: 100000000, note: here}\n"
CALIBRATION = {"target": "chessboard:7x5:0.03", "cameras": {"video": {"fx": 1.0}}, "verdict": "good", "reasons": []}


def make_strangers(root: Path, case: Path) -> list[Item]:
    """Writes all of them below a folder; each is worked on as `case`, which paths in their files begin with."""
    found = [_lesson, _killed, _kept, lambda place: _scenario(place, case), _plan, _run]
    for make in found:
        (root / str(found.index(make))).mkdir(parents=True)
    return [make(root / str(number)) for number, make in enumerate(found)]


def _lesson(folder: Path) -> Item:
    (folder / "mine.md").write_text(LESSON)
    return Item("lesson", folder, (("lesson", "{}/mine.md"),), 5)


def _killed(folder: Path) -> Item:
    killed_run(folder.with_name("killed")).rename(folder / "run")
    return Item("killed run", folder, (("repair", "{}/run"), ("repair", "{}/run"), ("repair", "{}")), 8)


def _kept(folder: Path) -> Item:
    for name in ("calibrations/2030-01-01", "calibrations/2031-01-01", "drive"):
        (folder / name).mkdir(parents=True)
    for place in (folder / "calibrations").iterdir():
        (place / NUMBERS).write_text(json.dumps(CALIBRATION, indent=1))
        (place / RIG).write_text(rig_text(doubles.rig()))
        (place / REPORT).write_text("<!DOCTYPE html>")
    (folder / "drive.notes.yaml").write_text(NOTES + "about: {source: a, exposures: 3, duration_s: 1.5}\n")
    (folder / "drive.rrd").write_bytes(b"RRF2")
    (folder / "drive" / "run.yaml").write_text(DRIVE)
    (folder / "drive" / "notes.yaml").write_text(NOTES)
    return Item("recordings", folder, (("listed", "{}"),), 5)


def _scenario(folder: Path, case: Path) -> Item:
    (folder / "scenario.yaml").write_text(SCENARIO.format(case=case))
    (folder / "walk.tum").write_text("".join(f"{0.1 * n:.1f} {0.1 * n:.1f} 0 0 0 0 0 1\n" for n in range(8)))
    (folder / "room.obj").write_text(
        "mtllib a.mtl\nv 0 0 5\nv 9 0 5\nv 0 9 5\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
    )
    (folder / "a.mtl").write_text("newmtl m\nmap_Kd a.png\n")
    cv2.imwrite(str(folder / "a.png"), np.full((8, 8, 3), 9, np.uint8))
    return Item("scenario", folder, (("opened", "{}/scenario.yaml"),), 6)


def _plan(folder: Path) -> Item:
    (folder / "plan.yaml").write_text(PLAN)
    return Item("plan", folder, (("plan", "{}/plan.yaml"),), 3)


def _run(folder: Path) -> Item:
    out = complete_run(folder.with_name("reviewed"), recording=True).rename(folder / "run")
    (out / "notes.yaml").write_text(NOTES)
    return Item("run to review", folder, (("reviewed", "{}/run"),), 4)


def lesson(path: str) -> None:
    found = own_lesson(path)
    assert found is not None
    for text in (found.about, *(part for step in found.steps for part in (step.before, step.after))):
        html(text)


def listed(path: str) -> None:
    """What the page's lists show, and that it is JSON which browsers read."""
    folder = Path(path)
    kept = [vars(each) for each in kept_in(folder / "calibrations")]
    list(files_of(folder / "calibrations"))
    recordings = list_recordings(folder)
    unfinished(folder)
    json.dumps([kept, message_of(State("double").having(Recordings(listed=recordings)))], allow_nan=False)


def opened(path: str) -> None:
    sequence = open_sequence(path)
    assert sequence.truth is not None


def plan(path: str) -> None:
    list(read_plan(Experiment(plan=path, out=Path(path).parent / "out")).runs())


def reviewed(path: str) -> None:
    stored = stored_at(path, lambda source, _: open_sequence(source), helpers.build)
    if stored is not None:
        for _ in stored.records():
            pass
        read_notes(notes_of(stored.path), stored.playback.sequence)


ACTIONS: dict[str, Callable[[str], None]] = {
    "lesson": lesson,
    "listed": listed,
    "opened": opened,
    "plan": plan,
    "reviewed": reviewed,
}
"""What is done with an item that is not a command of the program."""
