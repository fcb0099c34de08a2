"""A config dataclass as viser inputs, and back. Labels, ranges and hints come from the dataclass itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args, get_origin

import viser

from ispom.settings import Setting, settings

UNITS = {"px": "px", "m": "m", "s": "s", "ns": "ns", "deg": "°", "rad": "rad", "percent": "%", "ms": "ms"}
WIDE = 1000.0
"""Ratio of the ends of a range above which a number is typed instead of chosen by a slider."""
LABELS = {
    "min_share": "overlap for a keyframe",
    "focal_sigma": "focal length uncertainty",
    "radial_sigma": "distortion uncertainty",
}
"""Labels of settings whose name does not explain itself."""


class ConfigForm:
    """The inputs of one config. `value` returns their config; `show` sets them without calling back."""

    def __init__(self, gui: viser.GuiApi, config: Any, changed: Callable[[Any], None] = lambda _: None) -> None:
        self._config, self._changed, self._showing = config, changed, False
        self._kinds = {s.name: s.type for s in settings(type(config))}
        self._inputs = {s.name: _input(gui, s, getattr(config, s.name)) for s in settings(type(config))}
        for handle in self._inputs.values():
            handle.on_update(lambda _: None if self._showing else self._changed(self.value))

    @property
    def value(self) -> Any:
        return replace(self._config, **{name: self._read(name) for name in self._inputs})

    def show(self, config: Any) -> None:
        self._showing = True
        try:
            for name, handle in self._inputs.items():
                if self._read(name) != getattr(config, name):
                    handle.value = _shown(getattr(config, name), self._kinds[name])
        finally:
            self._showing = False

    def offer(self, names: frozenset[str]) -> None:
        """Shows only the inputs of these fields. The others are hidden and keep their values."""
        for name, handle in self._inputs.items():
            if handle.visible != (name in names):
                handle.visible = name in names

    def _read(self, name: str) -> Any:
        """Returns the value of an input in the type of its field. Empty or 0 is None where the field allows None."""
        kind, value = self._kinds[name], self._inputs[name].value
        inner = _inner(kind)
        if inner is not kind and not value:
            return None
        return inner(value) if inner in (int, float, str, Path) else value


def label_of(name: str) -> str:
    """`min_parallax_px` -> "min parallax [px]"."""
    if name in LABELS:
        return LABELS[name]
    if unit := unit_of(name):
        return f"{' '.join(name.split('_')[:-1])} [{unit}]"
    return " ".join(name.split("_"))


def unit_of(name: str) -> str:
    """Returns the unit of a field's numbers, by the end of its name; empty for counts and ratios."""
    _, _, last = name.rpartition("_")
    return UNITS.get(last, "") if last != name else ""


def hint_of(setting: Setting) -> str:
    """Returns the help of a setting and its range, with the unit."""
    unit, limits, text = unit_of(setting.name), setting.range, " ".join(setting.help.split())
    if limits is not None:
        return f"{text} ({limits.low:g} to {limits.high:g}{' ' if unit else ''}{unit})"
    return f"{text} [{unit}]" if unit else text


def _inner(kind: Any) -> Any:
    """`int` of `int | None`; anything else itself."""
    others = [k for k in get_args(kind) if k is not NoneType]
    return others[0] if NoneType in get_args(kind) else kind


def _shown(value: Any, kind: Any) -> Any:
    """Returns a field's value in the form that its input shows."""
    if value is None:
        return 0 if _inner(kind) in (int, float) else ""
    return str(value) if isinstance(value, Path) else value


def _input(gui: viser.GuiApi, setting: Setting, value: Any) -> Any:
    label, hint, limits = label_of(setting.name), hint_of(setting), setting.range
    kind, value = _inner(setting.type), _shown(value, setting.type)
    if get_origin(kind) is Literal:
        return gui.add_dropdown(label, get_args(kind), initial_value=value, hint=hint)
    if kind is bool:
        return gui.add_checkbox(label, value, hint=hint)
    if kind in (int, float):
        if limits is None:
            return gui.add_number(label, value, hint=hint)
        low, high = kind(limits.low), kind(limits.high)
        if high - low > WIDE * max(abs(low), 1e-9) and kind is float:
            return gui.add_number(label, value, min=low, max=high, hint=hint)
        return gui.add_slider(label, low, high, _step(kind, low, high), value, hint=hint)
    return gui.add_text(label, str(value), hint=hint)


def _step(kind: type, low: float, high: float) -> Any:
    """A round step, about a hundredth of the range: 1, 2 or 5 times a power of ten; whole for int."""
    if kind is int:
        return 1
    rough = max(high - low, 1e-9) / 200
    power = 10.0 ** int(f"{rough:e}".split("e")[1])
    return next(power * m for m in (1, 2, 5, 10) if power * m >= rough)
