"""Files of each dialect of calibrations and poses, changed or damaged: never a traceback, a hang, or another dialect.

The default run has 1,000 damaged files and 200 that are offered to all other dialects; `pytest -m slow` offers 200 of
each.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.io.calibrations import dialects as calibrations
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.recognised import one_camera, one_rig
from ispom.io.poses import dialects as poses
from ispom.io.poses.content import PoseContent
from ispom.io.poses.recognised import read_trajectory
from tests.io import dialect_examples, pose_examples
from tests.io.dialect_examples import mutations

EXAMPLES = (*dialect_examples.EXAMPLES, *pose_examples.EXAMPLES)
DAMAGED, OFFERED, OFFERED_EACH = 1000, 200, 200
LEAST_LINES = 4
"""A part of a file that is left has that many lines: one row of numbers may be of several dialects."""
MOST_S = 10.0
"""Of reading one small file, on a busy machine."""
BARE = "ispom_camera"
"""What the rest of other YAML is where little more than fx, fy, cx and cy is left: those must be the same."""
INTRINSICS = {(each.fx, each.fy, each.cx, each.cy) for each in (dialect_examples.CAMERA, dialect_examples.SIDE)}
NUMBER = re.compile(rb"(?<![\w.])-?\d+\.\d+(?:e[-+]?\d+)?(?![\w.])")
Reader = Callable[[Path], str | None]


def as_calibration(path: Path) -> str | None:
    """The name of the dialect by which a file is read."""
    found = calibrations.recognised(Content.of(path))
    one_rig((path,), size=lambda: (320, 240))
    return found.name if found else None


def as_poses(path: Path) -> str | None:
    found = poses.recognised(PoseContent(path))
    read_trajectory(path)
    return found.name if found else None


def changed(content: bytes, random: np.random.Generator) -> bytes:
    """The file with other line ends, blanks, digits, or without some of its lines; a binary one is the same."""
    if b"\0" in content:
        return content
    lines = content.split(b"\n")
    first, last = sorted(random.integers(0, len(lines) + 1, 2).tolist())
    part = lines[first:last] if last - first >= LEAST_LINES else lines
    changes: list[Callable[[], bytes]] = [
        lambda: content.replace(b"\r\n", b"\n").replace(b"\n", b"\r\n"),
        lambda: b"\n".join(line for line in lines if random.random() > 0.1),
        lambda: NUMBER.sub(lambda n: repr(float(n[0]) * (1 + 1e-5 * random.standard_normal())).encode(), content),
        lambda: b"\xef\xbb\xbf" + content,
        lambda: b"\n".join(line + b"  " for line in lines),
        lambda: b"\n".join(part),
        lambda: content.replace(b" ", b"  "),
    ]
    return changes[int(random.integers(len(changes)))]()


def files(folder: Path, count: int, change: Callable[[bytes, int], bytes]) -> Iterator[tuple[str, Path]]:
    """The dialects of `count` files, as many of each example as of the others, and the files."""
    for n in range(count):
        example = EXAMPLES[n % len(EXAMPLES)]
        place = folder / str(n % len(EXAMPLES))
        place.mkdir(exist_ok=True)
        for name, content in getattr(example, "beside", ()):
            (place / name).write_bytes(content)
        path = place / example.name
        path.write_bytes(change(example.content, n))
        yield example.dialect, path


def offered(count: int, folder: Path) -> list[tuple[str, str | None, bytes]]:
    """What was read as a file of another dialect: both names and the file."""
    random = np.random.default_rng(count)
    wrong = []
    for dialect, path in files(folder, count, lambda content, _: changed(content, random)):
        for read in (as_calibration, as_poses):
            try:
                found = read(path)
            except InputError:
                continue
            if found != dialect and not (found == BARE and same_intrinsics(path)):
                wrong.append((dialect, found, path.read_bytes()))
    return wrong


def same_intrinsics(path: Path) -> bool:
    camera = one_camera(path, lambda: (320, 240))[0]
    return (camera.fx, camera.fy, camera.cx, camera.cy) in INTRINSICS


def test_a_damaged_file_of_any_dialect_is_read_or_refused_soon_in_one_sentence(tmp_path: Path) -> None:
    def damaged(content: bytes, n: int) -> bytes:
        return mutations(content, 5, seed=n)[n // len(EXAMPLES) % 5]

    for _, path in files(tmp_path, DAMAGED, damaged):
        for read in (as_calibration, as_poses):
            begin = time.monotonic()
            try:
                read(path)
            except InputError as fault:
                assert "\n" not in str(fault) and str(path) in str(fault)
            assert time.monotonic() - begin < MOST_S, path.read_bytes()


def test_a_changed_file_is_read_by_its_own_dialect_or_refused(tmp_path: Path) -> None:
    assert not offered(OFFERED, tmp_path)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_many_changed_files_of_each_dialect_are_read_by_it_or_refused(tmp_path: Path) -> None:
    assert not offered(OFFERED_EACH * len(EXAMPLES), tmp_path)


def test_what_is_left_of_a_file_is_of_no_other_dialect(tmp_path: Path) -> None:
    """What once was: the rest of Open3D's JSON a matrix by rows, that of a matrix positions, a CSV in seconds EuRoC."""
    for name, text, read in (
        ("a.json", "226.0,\n0,\n0,\n0,\n227.5,\n0,\n160.9,\n118.3,\n1\n]\n}\n", as_calibration),
        ("a.txt", "0 227.5 118.3 0\n0 0 1 0\n0 0 0 1\n", as_poses),
        ("a.csv", "1700000000.000000000,0.0,0.0,0.0,1.0,0.0,0.0,0.0\n", as_poses),
        ("a.yaml", "Camera.fx: 190\nCamera.fy: 190\nCamera.cx: 255\nCamera.cy: 257\nCamera.k2: 0.1\nCamera.k4: 0.2\n"
         "Camera.cols: 512\nCamera.rows: 512\n", as_calibration),
    ):  # fmt: skip
        path = tmp_path / name
        path.write_text(text)
        with pytest.raises(InputError):
            read(path)
