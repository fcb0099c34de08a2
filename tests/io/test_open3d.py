"""Where Open3D or a library below it is missing, one sentence says what to install."""

from __future__ import annotations

import pytest

from ispom.errors import InputError
from ispom.io import open3d as module


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        (ModuleNotFoundError("No module named 'open3d'", name="open3d"), "run 'pip install open3d'"),
        (
            OSError("libusb-1.0.so.0: cannot open shared object file: No such file"),
            r"libusb-1\.0\.so\.0: .*libusb-1\.0",
        ),
        (ImportError("/lib/x86_64-linux-gnu/libEGL.so.1: file too short"), r"library libEGL\.so\.1: install it"),
        (ImportError("DLL load failed while importing pybind"), "DLL load failed .*: install it again"),
    ],
    ids=["not installed", "no libusb", "a broken libEGL", "a broken Open3D"],
)
def test_what_is_missing_is_named_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch, fault: Exception, sentence: str
) -> None:
    def fail(_: str) -> None:
        raise fault

    monkeypatch.setattr(module, "import_module", fail)
    with pytest.raises(InputError, match=sentence) as caught:
        module.open3d()
    assert "\n" not in str(caught.value)


def test_a_module_that_open3d_itself_lacks_is_no_mistake_of_the_user(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: str) -> None:
        raise ModuleNotFoundError("No module named 'numpy'", name="numpy")

    monkeypatch.setattr(module, "import_module", fail)
    with pytest.raises(ModuleNotFoundError):
        module.open3d()
