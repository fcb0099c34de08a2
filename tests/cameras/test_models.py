"""Every registered camera model keeps the contract of its Protocol."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.metadata import EntryPoint

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ispom import registry
from ispom.cameras import BUILT_IN, CAMERA_MODELS, Camera, CameraModel, Equirectangular, Pinhole, model_of
from ispom.errors import InputError
from ispom.testing.cameras import check_camera_model

SMALL = st.floats(-0.02, 0.02)
COEFFICIENTS = {
    "pinhole": st.just(()),
    "radtan": st.one_of(st.tuples(*[SMALL] * 4), st.tuples(*[SMALL] * 5)),
    "rational": st.tuples(*[SMALL] * 8),
    "fisheye": st.tuples(*[SMALL] * 4),
    "equirectangular": st.just(()),
}
"""By model, coefficients of lenses whose distortion can be undone in the whole image."""


def camera(name: str, focal_px: float, distortion: Sequence[float]) -> Camera:
    if name == "equirectangular":
        return Equirectangular.camera(2 * round(focal_px), round(focal_px))
    lens = "fisheye" if name == "fisheye" else "opencv"
    return Camera(640, 480, focal_px, 1.02 * focal_px, 318.2, 243.1, tuple(distortion), lens)


@pytest.mark.parametrize("name", COEFFICIENTS)
@given(data=st.data(), focal_px=st.floats(350, 900))
@settings(max_examples=25, deadline=None)
def test_each_model_keeps_the_contract(name: str, data: st.DataObject, focal_px: float) -> None:
    found = camera(name, focal_px, data.draw(COEFFICIENTS[name]))
    assert found.model.name == name
    check_camera_model(found)


def test_all_built_in_models_are_checked() -> None:
    assert COEFFICIENTS.keys() == {model.name for model in BUILT_IN}
    assert [m.name for m in map(model_of, ["opencv"] * 4, (0, 4, 5, 8))] == ["pinhole", "radtan", "radtan", "rational"]


def test_pixels_that_no_ray_explains_are_not_valid() -> None:
    for lens, focal_px, k1 in (("opencv", 300.0, -0.6), ("fisheye", 150.0, 0.0)):
        strong = Camera(640, 480, focal_px, focal_px, 319.5, 239.5, (k1, 0.0, 0.0, 0.0), lens)
        rays, valid = strong.unproject(np.array([[319.5, 239.5], [0.0, 0.0]]))
        assert valid.tolist() == [True, False] and np.isfinite(rays).all(), lens
        np.testing.assert_allclose(rays[0], [0, 0, 1], atol=1e-9)


def test_a_panorama_has_every_direction() -> None:
    found = Equirectangular.camera(640, 320)
    x = np.array([[0, 0, 1.0], [2, 0, 0], [-3, 0, 0], [0, 1, 1.0], [1e-12, 0, -1], [0, -1, 0]])
    expected = [[319.5, 159.5], [479.5, 159.5], [159.5, 159.5], [319.5, 239.5], [639.5, 159.5], [319.5, -0.5]]
    np.testing.assert_allclose(found.project(x), expected, atol=1e-6)
    assert np.isnan(found.project(np.zeros((1, 3)))).all() and np.isnan(found.project_jacobian(x[-1:])).all()
    u, v = np.meshgrid(np.arange(640.0), np.arange(320.0))
    _, valid = found.unproject(np.stack([u.ravel(), v.ravel()], axis=1))
    assert valid.all()
    assert not found.unproject(np.array([[-2.0, 100.0], [50.0, 321.0]]))[1].any()


def test_points_behind_have_no_jacobian() -> None:
    for distortion in ((), (-0.1, 0.02, 0.0, 0.0)):
        found = camera("radtan", 500.0, distortion).project_jacobian(np.array([[0, 0, 2.0], [0, 0, -2.0]]))
        assert np.isfinite(found[0]).all() and np.isnan(found[1]).all()


class _Broken(Pinhole):
    def jacobian(self, camera: Camera, xyz_in_camera: np.ndarray) -> np.ndarray:
        return 1.01 * super().jacobian(camera, xyz_in_camera)


class _Shifted(Pinhole):
    def unproject(self, camera: Camera, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return super().unproject(camera, uv + 0.1)


BROKEN, SHIFTED, FINE = _Broken("broken"), _Shifted("shifted"), Pinhole("fine")


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[None]:
    """With entry points of this module's names."""
    points = [EntryPoint(name, f"{__name__}:{value}", CAMERA_MODELS.group) for name, value in request.param]
    monkeypatch.setattr(registry, "entry_points", lambda group: points if group == CAMERA_MODELS.group else [])
    CAMERA_MODELS.refresh()
    yield
    CAMERA_MODELS.refresh()


@pytest.mark.parametrize("installed", [[("broken", "BROKEN"), ("shifted", "SHIFTED")]], indirect=True)
def test_what_breaks_the_contract_is_found(installed: None) -> None:
    for name, reason in (("broken", "Jacobians that differ by"), ("shifted", "px from their pixels")):
        with pytest.raises(AssertionError, match=reason):
            check_camera_model(Camera(640, 480, 500.0, 500.0, 319.5, 239.5, lens=name))


@pytest.mark.parametrize("installed", [[("fine", "FINE"), ("taken", "PINHOLE"), ("gone", "NOTHING")]], indirect=True)
def test_packages_add_models_and_those_that_cannot_be_loaded_are_named(installed: None) -> None:
    assert CAMERA_MODELS.get("fine") is FINE and isinstance(FINE, CameraModel)
    assert len(CAMERA_MODELS.faults()) == 2
    with pytest.raises(InputError, match="'gone'"):
        Camera(640, 480, 500.0, 500.0, 319.5, 239.5, lens="gone").project(np.zeros((1, 3)))
