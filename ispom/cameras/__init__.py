"""Cameras, and the models of their lenses."""

from ispom.cameras.camera import Camera
from ispom.cameras.model import CameraModel
from ispom.cameras.registry import camera_models, model_of, require_opencv

__all__ = ["Camera", "CameraModel", "camera_models", "model_of", "require_opencv"]
