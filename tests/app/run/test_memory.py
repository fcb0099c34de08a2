"""What is of no use any more is given back, and what was given back is there again when it is used."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import cv2
import psutil
import pytest
from ispom_app.engine import memory

from ispom.types import StereoPair
from ispom.warm_up import flight, flight_rig

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="Linux alone")
ENTRY = """7f0000{start:02x}0000-7f0000{start:02x}8000 {rights} 00001000 fe:00 1{start} {path}
Size:                 32 kB
KernelPageSize:        4 kB
Rss:                  32 kB
Shared_Clean:         32 kB
Private_Dirty:         0 kB
Anonymous:      {anonymous:>6} kB
LazyFree:              0 kB
AnonHugePages:         0 kB
Swap:           {swap:>6} kB
SwapPss:               0 kB
THPeligible:           0
VmFlags: rd ex mr mw me
"""
LIBRARIES = """
import re
from ispom_app.engine import memory
import llvmlite.binding, numba
from pathlib import Path
def resident_mb():
    entries = re.split(r"\\n(?=[0-9a-f]+-)", Path("/proc/self/smaps").read_text())
    return sum(int(re.search(r"Rss: +(\\d+)", one)[1]) for one in entries if "libllvmlite" in one) / 1024
before = resident_mb()
memory.give_back()
assert resident_mb() == before  # nothing is known
memory.know_libraries()
memory.give_back()
assert before > 20 > 8 > resident_mb()
assert numba.njit(lambda x: x + 1)(2) == 3 and resident_mb() > 8
memory.give_back_libraries()
assert resident_mb() < 8
"""
RUN = """
from ispom_app.__main__ import main
from ispom_app.features.benchmark.measure import peak_mb
assert main() == 0
print(peak_mb())
"""


def entry(start: int, path: Path | str, rights: str = "r-xp", anonymous: int = 0, swap: int = 0) -> str:
    return ENTRY.format(start=start, rights=rights, path=path, anonymous=anonymous, swap=swap)


def drive_of(folder: Path) -> Path:
    """KITTI's way: pairs of a short flight."""
    rig = flight_rig()
    pairs = [exposure for exposure in flight(rig) if isinstance(exposure, StereoPair)]
    for name in ("image_0", "image_1"):
        (folder / "06" / name).mkdir(parents=True)
    for i, pair in enumerate(pairs):
        cv2.imwrite(str(folder / f"06/image_0/{i:06d}.png"), pair.left)
        cv2.imwrite(str(folder / f"06/image_1/{i:06d}.png"), pair.right)
    camera, baseline_m = rig.camera("left"), rig.baseline_m
    lines = [
        f"P{i}: {camera.fx} 0 {camera.cx} {-i * camera.fx * baseline_m} 0 {camera.fy} {camera.cy} 0 0 0 1 0"
        for i in (0, 1)
    ]
    (folder / "06" / "calib.txt").write_text("\n".join(lines))
    (folder / "06" / "times.txt").write_text("\n".join(str(1e-9 * pair.time_ns) for pair in pairs))
    return folder / "06"


def test_free_memory_between_pieces_in_use_is_given_back() -> None:
    pieces = [bytearray(50_000) for _ in range(2_000)]
    kept = pieces[::100]
    del pieces
    before = psutil.Process().memory_info().rss
    memory.give_back()
    assert before - psutil.Process().memory_info().rss > 60e6
    assert len(kept) == 20


def test_only_what_is_in_a_packages_library_is_given_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", ["", str(tmp_path)])
    library = tmp_path / "with space.libs" / "liba.so.1"
    entries = [
        entry(1, library),
        entry(2, library, "r--p"),
        entry(3, library, "r--p", anonymous=4),  # relocated, and protected then
        entry(4, library, "r--p", swap=4),
        entry(5, library, "rw-p"),
        entry(6, library, "r--s"),
        entry(7, library, "---p"),
        entry(8, "/usr/lib/libc.so.6"),
        entry(9, tmp_path / "numbers.npy", "r--p"),
        entry(10, ""),
        entry(11, f"{library} (deleted)"),  # of a package that was renewed meanwhile
    ]
    found = [(0x7F0000010000, 0x8000), (0x7F0000020000, 0x8000), (0x7F00000B0000, 0x8000)]
    assert list(memory._read_only("".join(entries))) == found


def test_libraries_are_known_in_the_main_thread_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "_libraries", [])
    other = threading.Thread(target=memory.know_libraries)
    other.start()
    other.join()
    assert not memory._libraries


def test_it_is_given_back_ever_less_often(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[int] = []
    monkeypatch.setattr(memory, "give_back_libraries", lambda: given.append(exposures))
    for exposures in range(1, 1001):
        memory.give_back_after(exposures)
    assert given == [1, 2, 4, 8, 16, 32, 64, 128, 256, 512]


def ran(script: str, *words: str) -> str:
    done = subprocess.run([sys.executable, "-c", script, *words], check=True, stdout=subprocess.PIPE, text=True)
    return done.stdout


def test_libraries_work_on() -> None:
    ran(LIBRARIES)


def test_a_run_with_its_recording_stays_small(tmp_path: Path) -> None:
    drive = drive_of(tmp_path)
    told = ran(RUN, "run", str(drive), "--methods", "stereo", "--out", str(tmp_path / "run"))
    assert float(told.split()[-1]) < 230
