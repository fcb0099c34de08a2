"""Open3D, for those parts that need it: its wheel loads system libraries that slim machines lack."""

from __future__ import annotations

import re
from importlib import import_module
from types import ModuleType

from ispom.errors import InputError


def open3d() -> ModuleType:
    """The module `open3d`, imported now. InputError where it, or a system library that it loads, is missing."""
    try:
        return import_module("open3d")
    except ModuleNotFoundError as error:
        if error.name != "open3d":
            raise
        raise InputError("this needs Open3D, which is not installed: run 'pip install open3d'") from error
    except (ImportError, OSError) as error:  # "libX.so.1: cannot open shared object file: ..."
        library = re.search(r"[\w.+-]+\.so[.\d]*", str(error))
        if library is None:
            raise InputError(f"Open3D cannot be loaded ({error}): install it again") from error
        raise InputError(
            f"Open3D cannot load the system library {library[0]}: install it (on Debian and Ubuntu: "
            "'apt-get install libusb-1.0-0 libegl1 libgl1 libx11-6 libidn2-0 libudev1 libgomp1')"
        ) from error
