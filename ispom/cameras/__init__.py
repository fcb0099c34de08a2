"""Cameras, and the models of their lenses."""

from ispom.cameras.camera import Camera
from ispom.cameras.model import CameraModel
from ispom.cameras.registry import CAMERA_MODELS, model_of, require_opencv

__all__ = ["CAMERA_MODELS", "Camera", "CameraModel", "model_of", "require_opencv"]
