"""Quantities of a test: of a step alone, and of a step and the one before it."""

from __future__ import annotations

from ispom_app.engine.history.quantity import ChangeQuantity, StepQuantity, number_of


def speed(before, now):
    """Distance over time, in the unit of the method [1/s]."""
    moved, was_s, here_s = (number_of(value) for value in (now.get("moved"), before.get("time_s"), now["time_s"]))
    return None if moved is None or was_s is None or here_s is None else moved / (here_s - was_s)


QUANTITIES = (
    StepQuantity("pose_count", lambda step, error_m: int(step.world_from_frame is not None), "poses given"),
    ChangeQuantity("speed", speed, "distance over time", unit="1/s"),
)
