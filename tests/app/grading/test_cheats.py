"""Submissions that cheat or misbehave: they earn little, harm nothing, and are reported in one sentence."""

from __future__ import annotations

import json
import os
import time
from contextlib import suppress
from io import StringIO
from pathlib import Path

import psutil
import pytest
from ispom_app.cli.main import main
from ispom_app.features.grading.measure import Measured, measured
from ispom_app.features.grading.process import Failure, Limits, SubmissionProcess

from ispom.ensemble import build
from ispom.methods import Config
from ispom.sequences import open_sequence

SOURCE = "sim:tiny?fault=dropped:share=0.5,from_s=1.5"
SHORT = ("--runs", "1", "--key", "a", "--no-contract")
LIMITS = Limits(200.0, 4.0)
PROJECT = '[project]\nname = "{name}"\nversion = "0"\n[project.entry-points."ispom.methods"]\n'

HEAD = """
import gc, json, os, pathlib, sys
from dataclasses import dataclass
import numpy as np
import ispom
from ispom import Pose, Status, Step, Tracks, Trajectory

HERE = pathlib.Path(__file__).parent

def method(name, config):
    return ispom.Method(name, frozenset({"video"}), config, "own", "none")
"""

CHEAT_TRUTH = (
    HEAD
    + '''
from ispom.sequences.formats.simulated import rendered_source
from ispom.simulation.source import Source
from ispom.simulation.truth import Truth
from ispom.types import Sequence

def found():
    """All that is of use: in the callers' variables, in memory, in open files, and at the parent."""
    frame = sys._getframe()
    while frame is not None:
        yield from frame.f_locals.values()
        frame = frame.f_back
    yield from gc.get_objects()

def truth():
    for each in found():
        if type(each) in (Truth, Source):
            return each if type(each) is Truth else Truth(each)
        if type(each) is Sequence and each.truth is not None:
            (HERE / "found").touch()
    return None

def answer(frame, points):
    """A Step that is the truth: points of a grid in the first frame, and all that is asked of them."""
    known = truth()
    if known is None:
        return points, Step(frame.time_ns, Status.TRACKING, "video", Pose())
    (HERE / "found").touch()
    pose, camera = known.pose("video", frame.time_ns), known.camera("video")
    if points is None:
        u, v = np.meshgrid(np.arange(10, camera.width - 10, 15), np.arange(10, camera.height - 10, 15))
        depth = known.depth("video", frame.time_ns)[v, u].ravel()
        uv = np.column_stack([u.ravel(), v.ravel()]).astype(float)[depth < 1e3]
        rays = np.column_stack([camera.normalise(uv), np.ones(len(uv))])
        points = pose.apply(rays * depth[depth < 1e3, None])
    inside = pose.inverse().apply(points)
    uv = camera.project(inside)
    shown = (inside[:, 2] > 0) & (uv > 1).all(axis=1) & (uv < (camera.width - 2, camera.height - 2)).all(axis=1)
    ids = np.flatnonzero(shown)
    landmarks = ispom.Landmarks(ids, points[ids], np.zeros((len(ids), 3), np.uint8))
    tracks = {"video": Tracks.of(ids, uv[ids])}
    return points, Step(frame.time_ns, Status.TRACKING, "video", pose, tracks=tracks, landmarks=landmarks)

def notes():
    """What the process is told of its task: its command line, that of its parent, its variables and its files."""
    texts = [" ".join(sys.argv), *os.environ.values()]
    for pid in ("self", str(os.getppid())):
        try:
            texts.append(open(f"/proc/{pid}/cmdline").read())
            texts += [os.readlink(f"/proc/{pid}/fd/{fd}") for fd in os.listdir(f"/proc/{pid}/fd")]
        except OSError:
            pass
    return texts

@dataclass(frozen=True)
class Cheat:
    def build(self, rig):
        return self
    def start(self):
        return (), None
    def step(self, state, frame):
        poses, points = state
        points, step = answer(frame, points)
        if not poses:
            (HERE / "notes.json").write_text(json.dumps(notes()))
        return ((*poses, (frame.time_ns, step.world_from_frame)), points), step
    def finish(self, state):
        return Trajectory.of(list(state[0]), "video")

cheat_truth = method("cheat_truth", Cheat)
'''
)

CHEAT_TRACKS = (
    HEAD
    + '''
@dataclass(frozen=True)
class Cheat:
    def build(self, rig):
        return self
    def start(self):
        return None, np.zeros((0, 2), np.float32), 0
    def step(self, state, frame):
        """Three real tracks, and 150 random points with new ids."""
        before, uv, count = state
        grey = ispom.as_grey(frame.image)
        if before is None:
            uv = np.asarray(ispom.detect_corners(grey, 3, np.zeros((0, 2), np.float32)), np.float32)
        else:
            uv, _ = ispom.Klt().track(before, grey, uv)
        height, width = grey.shape
        random = np.random.default_rng(count).uniform((0, 0), (width - 1, height - 1), (150, 2))
        ids = np.concatenate([np.arange(len(uv)), 1000 + 150 * count + np.arange(150)])
        tracks = Tracks.of(ids, np.concatenate([uv, random]))
        step = Step(frame.time_ns, Status.LOST, "video", None, tracks={"video": tracks})
        return (grey, uv, count + 1), step
    def finish(self, state):
        return Trajectory.empty("video")

cheat_tracks = method("cheat_tracks", Cheat)
'''
)

BEHAVIOURS = {
    "raises": "raise AttributeError('no attribute nothing')",
    "exits": "os._exit(7)",
    "kills_its_parent": "os.kill(os.getppid(), 9)",
    "kills_itself": "os.kill(os.getpid(), 11)",
    "takes_memory": "held = np.ones(1 << 31)",
    "writes_answers": "[os.write(fd, b'x' * 1000) for fd in range(3, 12) if is_pipe(fd)]",
    "lies_about_time": "answer['time_ns'] = 0",
    "lies_about_sensor": "answer['frame'] = 'world'",
    "interrupts": "raise KeyboardInterrupt",
    "not_a_number": "answer['pose'] = Pose(np.full((3, 3), np.nan), np.full(3, np.inf))",
    "prints": "sys.stdout.write('x' * 3_000_000); sys.stderr.write('y' * 3_000_000); print(open(0).read())",
    "forks": "fork()",
    "waits": "pass",
}
BEHAVING = (
    HEAD
    + """
import stat, time

def is_pipe(fd):
    try:
        return stat.S_ISFIFO(os.fstat(fd).st_mode)
    except OSError:
        return False

def fork():
    pid = os.fork()
    if pid == 0:
        time.sleep(10000)
    (HERE / "forked").write_text(str(pid))

def made(code):
    def step(self, state, frame):
        answer = {"time_ns": frame.time_ns, "frame": "video", "pose": Pose()}
        if state == 2:
            exec(code)
        return state + 1, Step(answer["time_ns"], Status.TRACKING, answer["frame"], answer["pose"])
    body = {
        "build": lambda self, rig: self,
        "start": lambda self: 0,
        "step": step,
        "finish": lambda self, state: Trajectory.empty("video"),
    }
    return dataclass(frozen=True)(type("Behaving", (), body))

for name, code in json.loads((HERE / "behaviours.json").read_text()).items():
    globals()[name] = method(name, made(code))
"""
)


def package(folder: Path, module: str, code: str, methods: list[str]) -> str:
    (folder / f"{module}.py").write_text(code)
    lines = [f'{name} = "{module}:{name}"\n' for name in methods]
    (folder / "pyproject.toml").write_text(PROJECT.format(name=module) + "".join(lines))
    return str(folder)


@pytest.fixture(scope="module")
def behaving(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("behaving")
    (folder / "behaviours.json").write_text(json.dumps(BEHAVIOURS))
    return package(folder, "behaving_here", BEHAVING, list(BEHAVIOURS))


def graded(folder: str, report: Path, *options: str) -> dict:
    assert main(["grade", folder, *SHORT, "--json", str(report), *options]) == 0
    (found,) = json.loads(report.read_text())["methods"].values()
    return found


def test_a_walk_through_the_process_finds_no_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = tmp_path / "rendered"
    monkeypatch.setattr("ispom.sequences.formats.simulated.default_folder", lambda: cache)
    folder = package(tmp_path, "cheat_truth", CHEAT_TRUTH, ["cheat_truth"])
    found = graded(folder, tmp_path / "grade.json", "--key", "a-secret-word", "--max-exposures", "24")
    assert found["points"] < 30 and found["runs"][0]["failure"] is None
    assert not (tmp_path / "found").exists()
    assert not cache.exists(), "names of rendered images lead to the seed, and the next images can be read there"
    notes = json.loads((tmp_path / "notes.json").read_text())
    assert notes and not any("sim:" in note or "a-secret-word" in note for note in notes)
    assert not any(str(found["runs"][0]["seed"]) in note for note in notes)


def test_random_points_earn_nothing(tmp_path: Path) -> None:
    folder = package(tmp_path, "cheat_tracks", CHEAT_TRACKS, ["cheat_tracks"])
    found = graded(folder, tmp_path / "grade.json", "--max-exposures", "40")
    assert found["points"] < 5 and found["runs"][0]["failure"] is None
    assert found["stages"]["tracking"] < 2


def run(folder: str, name: str) -> Measured:
    return measured(folder, name, SOURCE, 3, 12, LIMITS)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("raises", "AttributeError: no attribute nothing at frame"),
        ("exits", "exit code 7"),
        ("kills_its_parent", "SIGKILL"),
        ("kills_itself", "SIGSEGV"),
        ("takes_memory", "MemoryError"),
        ("writes_answers", "it "),
        ("lies_about_time", "another time"),
        ("lies_about_sensor", "unknown sensor"),
        ("interrupts", "it "),
    ],
)
def test_what_goes_wrong_there_is_one_sentence(behaving: str, name: str, sentence: str) -> None:
    found = run(behaving, name)
    assert found.failure is not None and sentence in found.failure and found.failure.startswith("it ")
    assert "\n" not in found.failure and len(found.failure) < 500 and not found.values


@pytest.mark.parametrize("name", ["not_a_number", "prints", "forks"])
def test_what_does_no_harm_is_measured(behaving: str, name: str) -> None:
    found = run(behaving, name)
    assert found.failure is None
    poses = found.values["located_percent"]
    assert poses is not None and (poses < 100) == (name == "not_a_number"), "a pose of NaN is none"
    if name == "forks":
        pid = int((Path(behaving) / "forked").read_text())
        with suppress(psutil.NoSuchProcess):  # it is gone, or a zombie for ever where process 1 waits for nobody
            forked = psutil.Process(pid)
            with suppress(psutil.TimeoutExpired):
                forked.wait(5)
            assert forked.status() == psutil.STATUS_ZOMBIE


def test_time_is_limited(behaving: str) -> None:
    sequence = open_sequence(SOURCE, seed=3, max_exposures=3)
    with SubmissionProcess(behaving, ("waits",), LIMITS) as submission:
        submission.start("waits", sequence.rig)
        pid = submission._child.pid
        submission._deadline_s = time.monotonic()
        with pytest.raises(Failure, match="longer than 200 s"):
            submission.step(sequence[0])
    assert not psutil.pid_exists(pid)


def test_a_submission_is_given_what_a_run_gives(tmp_path: Path) -> None:
    """The same Steps to the last bit, in a folder of its own that is gone afterwards."""
    sequence = open_sequence(SOURCE, seed=3, max_exposures=6)
    ensemble = build(Config(), ("monocular.paper",), sequence.rig)
    state = ensemble.start()
    with SubmissionProcess("monocular.paper", (), LIMITS) as submission:
        folder = Path(submission._folder.name)
        assert Path(os.readlink(f"/proc/{psutil.Process(submission._child.pid).children()[0].pid}/cwd")) == folder
        submission.start("monocular.paper", sequence.rig)
        for i in range(len(sequence)):
            state, steps = ensemble.step(state, sequence[i])
            answers = submission.step(sequence[i])
            assert len(steps) == len(answers)
            for step, answer in zip(steps, answers, strict=True):
                own, other = step.tracks["video"], answer.tracks["video"]
                assert (own.ids == other.ids).all() and (own.uv == other.uv).all()
                assert (step.world_from_frame is None) == (answer.world_from_frame is None)
                if step.world_from_frame is not None and answer.world_from_frame is not None:
                    assert (step.world_from_frame.translation == answer.world_from_frame.translation).all()
        assert submission.finish().frame == "video"
    assert not folder.exists()


def test_the_key_may_come_from_standard_input(
    behaving: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", StringIO("\n"))
    assert main(["grade", behaving, "--key", "-"]) == 2
    assert "standard input" in capsys.readouterr().err
