"""Programs for tests: the example of this repository, and one with a fault."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from ispom.estimators.program.estimator import ProgramConfig
from ispom.types import Camera, Rig, VideoFrame

COMPASS = Path(__file__).parents[3] / "examples" / "external_program" / "compass.py"
PYTHON = (sys.executable, "-E", "-S")
SAVES, FORGETS = (*PYTHON, str(COMPASS)), (*PYTHON, str(COMPASS), "--forget")
RIG = Rig.single(Camera(320, 240, 230.0, 230.0, 159.5, 119.5))
AT = 2
"""The exposure at which the one with a fault has it."""
FAULTY = """
import json, os, signal, subprocess, sys, time
def say(answer):
    sys.stdout.write(json.dumps(answer) + "\\n")
    sys.stdout.flush()
with open(sys.argv[1], "a") as file:
    file.write(f"{os.getpid()}\\n")
GOOD = {"status": "tracking", "pose": {"translation": [0, 0, 0], "rotation_xyzw": [0, 0, 0, 1]}}
while line := sys.stdin.buffer.readline():
    request = json.loads(line)
    if request["type"] == "hello":
        say({"version": 1, "frame": "rig", "unit": "own"})
    elif request["type"] == "start":
        say({})
    elif request["index"] < AT:
        sys.stdin.buffer.read(request["images"][0]["bytes"])
        say(GOOD)
    else:
        FAULT
"""


def config(command: tuple[str, ...], **settings: Any) -> ProgramConfig:
    return type("Tested", (ProgramConfig,), {"name": "tested", "command": command})(**settings)


def faulty(folder: Path, fault: str, **settings: Any) -> ProgramConfig:
    """A program that answers well before exposure AT, and there does this; its process ids go to folder/pids."""
    script = folder / "faulty.py"
    script.write_text(FAULTY.replace("AT:", f"{AT}:").replace("FAULT", fault.replace("\n", "\n        ")))
    return config((*PYTHON, str(script), str(folder / "pids")), **settings)


def frames(count: int) -> Iterator[VideoFrame]:
    """A texture that moves to the side."""
    texture = np.kron(np.random.default_rng(1).integers(0, 255, (30, 60), dtype=np.uint8), np.ones((8, 8), np.uint8))
    for i in range(count):
        yield VideoFrame(i * 33_000_000, np.ascontiguousarray(texture[:, 3 * i : 3 * i + 320]))


def walk(estimator: Any, count: int, state: Any = None, hook: Callable[[int], None] = lambda _: None) -> list[Any]:
    """The States from the start, or this one, on."""
    states = [estimator.start() if state is None else state]
    for i, frame in enumerate(frames(count)):
        hook(i)
        states.append(estimator.step(states[-1], frame)[0])
    return states


def assert_all_gone(pids: Path) -> None:
    """Every process that wrote its id there."""
    listed = [int(line) for line in pids.read_text().split()]
    assert listed
    for pid in listed:
        try:
            psutil.Process(pid).wait(20)
        except psutil.NoSuchProcess:
            continue
