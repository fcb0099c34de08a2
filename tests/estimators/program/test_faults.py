"""A program that fails is a sentence with frame, fault and its last words, and no process is left behind."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from ispom.errors import InputError
from ispom.estimators.program.estimator import Program, program_method
from tests.estimators.program.programs import AT, PYTHON, RIG, assert_all_gone, config, faulty, walk

posix = pytest.mark.skipif(os.name != "posix", reason="signals and process groups")
ENDLESS_SLEEP = "time.sleep(600)"
ENDLESS = "while True:\n    sys.stdout.write('x' * 1_000_000)"
FAULTS = {
    "sys.stderr.write('no memory\\n'); sys.exit(3)": r"ended with exit code 3 \(no memory\)",
    "print('loaded', flush=True)": "answers 'loaded', which is not JSON",
    "print('[1, 2]', flush=True)": r"answers '\[1, 2\]', which is not a JSON object",
    "print('[' * 100_000, flush=True)": "which is not JSON",
    "sys.stdout.buffer.write(b'\\xff\\x00\\n'); sys.stdout.flush()": "which is not JSON",
    "say({**GOOD, 'pose': {'translation': [float('nan'), 0, 0], 'rotation_xyzw': [0, 0, 0, 1]}})": "NaN is no number",
    "say({'error': 'no vocabulary'})": "says 'no vocabulary'",
    "say({**GOOD, 'state_bytes': 3})": "answers with state_bytes, but said that saves is False",
    ENDLESS: "answers with a line of more than 16 MB",
    "sys.stderr.write('what I said\\n'); print('{', flush=True); time.sleep(600)": r"standard error: what I said\)",
}


def stopped(folder: Path, fault: str, **settings: float) -> str:
    """The sentence with which stepping ends."""
    with pytest.raises(InputError) as caught:
        walk(faulty(folder, fault, **settings).build(RIG), AT + 1)
    assert_all_gone(folder / "pids")
    return str(caught.value)


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named(fault: str, tmp_path: Path) -> None:
    said = stopped(tmp_path, fault)
    assert re.match(rf"tested: its program .*{FAULTS[fault]}", said)
    assert f"at frame {AT} of those" in said and "mend the program" in said


@posix
def test_a_crash_is_named(tmp_path: Path) -> None:
    assert "SIGSEGV" in stopped(tmp_path, "os.kill(os.getpid(), signal.SIGSEGV)")


def test_a_program_that_closes_its_output_is_not_waited_for(tmp_path: Path) -> None:
    assert "standard output" in stopped(tmp_path, "os.close(1); time.sleep(600)")


@pytest.mark.parametrize("fault", ["time.sleep(600)", "sys.stdin.close(); time.sleep(600)"])
def test_silence_ends_after_the_time(fault: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"within 3 s, at frame \d"):
        walk(Program(faulty(tmp_path, fault, timeout_s=3.0), RIG), AT + 1)  # less than the settings allow
    assert_all_gone(tmp_path / "pids")


@posix
def test_all_that_the_program_started_ends_with_it(tmp_path: Path) -> None:
    child = "subprocess.Popen(['sleep', '600'], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)"
    stopped(tmp_path, f"print({child}.pid, file=open(sys.argv[1], 'a'), flush=True); sys.exit(1)")


@posix
def test_a_program_ends_when_ispom_is_killed(tmp_path: Path) -> None:
    """With one that does not read, and has more to write than a pipe takes."""
    code = (
        "import os, signal, threading; from pathlib import Path\n"
        "from tests.estimators.program.programs import RIG, AT, faulty, walk\n"
        f'tested = faulty(Path({str(tmp_path)!r}), \'open(sys.argv[1] + ".there", "w"); {ENDLESS_SLEEP}\')\n'
        "def die():\n"
        f"    while not Path({str(tmp_path / 'pids.there')!r}).exists(): pass\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
        "threading.Thread(target=die).start()\n"
        "walk(tested.build(RIG), AT + 1)\n"
    )
    root = Path(__file__).parents[3]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, timeout=100, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert_all_gone(tmp_path / "pids")


def test_one_that_ends_when_it_is_greeted_is_no_method(tmp_path: Path) -> None:
    script = tmp_path / "ends.py"
    script.write_text("import sys; sys.exit('no licence')")
    with pytest.raises(InputError, match=r"exit code 1 \(no licence\)"):
        program_method(type(config((*PYTHON, str(script)))), ("video",))


def test_one_that_is_not_there_is_no_method() -> None:
    with pytest.raises(InputError, match="no-such-program"):
        program_method(type(config(("no-such-program",))), ("video",))


def test_after_a_fault_the_next_step_starts_again(tmp_path: Path) -> None:
    once = "if not os.path.exists('ONCE'):\n    open('ONCE', 'w'); sys.exit(1)\nsay(GOOD)"
    estimator = faulty(tmp_path, once.replace("ONCE", str(tmp_path / "once"))).build(RIG)
    states = walk(estimator, AT)
    with pytest.raises(InputError, match="exit code 1"):
        walk(estimator, 1, states[-1])
    assert walk(estimator, 1, states[-1])[-1].count == AT + 1
