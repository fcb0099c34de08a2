"""`python -m tests.kernel_list` writes ispom/kernels.json: the kernels of each method, found by running it.

The seconds are the CPU time of this machine, compiled one after the other into an empty folder.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from itertools import islice
from pathlib import Path
from typing import Any

from ispom.errors import InputError
from ispom.kernel_list import FILE
from ispom.kernels import compile_kernel, kernels
from ispom.methods import BUILT_IN, SURVEY, method
from ispom.types import Rig

PATH = Path(__file__).parents[1] / "ispom" / FILE
METHODS = (*BUILT_IN, *SURVEY)


def run_method(name: str) -> None:
    """Runs a method, and what it asks, on the flight or on a scene of its own."""
    from ispom.testing.flight import flight, flight_rig
    from tests.alone import OF_CAMERAS, OWN_SEQUENCES, alone

    rig: Rig
    if name in OWN_SEQUENCES:
        sequence = OWN_SEQUENCES[name]()
        rig, measurements = sequence.rig, islice(iter(sequence), 60)
    else:
        rig = flight_rig(name in OF_CAMERAS)
        measurements = iter(flight(rig, name in OF_CAMERAS))
    settings = None
    if name == "monocular.paper":
        from ispom.estimators.paper.monocular import MonocularConfig

        settings = MonocularConfig(local_bundle=True)
    try:
        estimator = alone(name, rig, settings)
    except InputError:
        return  # it needs other sensors, or an extra: what is its own compiles at its first use
    state = estimator.start()
    for measurement in measurements:
        state, _ = estimator.ensemble.step(state, measurement)
    estimator.finish(state)


def called() -> dict[str, list[Any]]:
    """The kernels that were called in this process, with the types of their arguments."""
    found = dict[str, list[Any]]()
    for kernel in kernels():
        name = f"{kernel.py_func.__module__.removeprefix('ispom.')}.{kernel.py_func.__name__}"
        for types in kernel.signatures:
            assert name not in found, f"{name} is compiled for more types than one"
            found[name] = [described(each) for each in types]
    return found


def described(kind: Any) -> Any:
    """As `compile_kernel` takes it."""
    if hasattr(kind, "instance_class"):
        tuple_class = kind.instance_class
        name = f"{tuple_class.__module__.removeprefix('ispom.')}.{tuple_class.__name__}"
        return {name: [described(each) for each in kind.types]}
    if hasattr(kind, "ndim"):
        assert kind.layout == "C", kind
        return f"{kind.dtype} {kind.ndim}" + ("" if kind.mutable else " readonly")
    return str(kind)


def of_method(name: str) -> dict[str, list[Any]]:
    """The kernels of a method and of those that it asks, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.kernel_list", name],
        capture_output=True,
        text=True,
        check=True,
        cwd=PATH.parents[1],
    )
    return json.loads(done.stdout)


def seconds(listed: dict[str, list[Any]]) -> dict[str, float]:
    """CPU time of compiling each."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "tests.kernel_list", "--seconds"]
        environment = os.environ | {"XDG_CACHE_HOME": folder}
        text = json.dumps(listed)
        done = subprocess.run(command, input=text, capture_output=True, text=True, check=True, env=environment)
    return json.loads(done.stdout)


def main() -> None:
    if sys.argv[1:] == ["--seconds"]:
        took = dict[str, float]()
        for name, types in json.loads(sys.stdin.read()).items():
            before = time.process_time()
            compile_kernel(name, types)
            took[name] = round(time.process_time() - before, 1)
        sys.stdout.write(json.dumps(took))
    elif sys.argv[1:]:
        run_method(sys.argv[1])
        sys.stdout.write(json.dumps(called()))
    else:
        write()


def write() -> None:
    by_method = {name: of_method(name) for name in METHODS}
    listed, methods = dict[str, list[Any]](), dict[str, list[str]]()
    for name, found in by_method.items():
        asked = set().union(*(by_method[other] for other in method(name).asks.values()), ())
        for kernel, types in found.items():
            assert listed.setdefault(kernel, types) == types, f"{kernel} is compiled for more types than one"
            if kernel not in asked:
                methods.setdefault(kernel, []).append(name)
    took = seconds(listed)
    rows = [
        json.dumps({"name": kernel, "seconds": max(took[kernel], 0.1), "methods": methods[kernel], "types": types})
        for kernel, types in sorted(listed.items())
    ]
    PATH.write_text("[\n" + ",\n".join(rows) + "\n]\n")


if __name__ == "__main__":
    main()
