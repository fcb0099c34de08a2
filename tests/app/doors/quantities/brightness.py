"""A quantity of a test."""

from __future__ import annotations

from ispom_app.engine.history.quantity import StepQuantity

QUANTITIES = (StepQuantity("pose_count", lambda step, error_m: int(step.world_from_frame is not None), "poses given"),)
