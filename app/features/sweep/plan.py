"""The plan of a sweep, as `ispom experiment` reads it."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import yaml

from ispom.errors import InputError
from ispom.methods import Config, method, with_asked

from ...engine.options import SourceOptions
from .values import Swept, Value, shown

QUANTITIES = ("ate_m", "ate_percent", "t_err_percent", "rpe_deg", "located_percent")


def plan_text(swept: Swept, source: str, options: SourceOptions, config: Config) -> str:
    """A line for each value; `config` has all other settings. InputError for what a plan cannot say."""
    if options.camera is not None:
        raise InputError(
            "a sweep takes the calibration that lies beside the images, not that of --camera: write it there"
        )
    others = _others(swept, config)
    setting = swept.setting.replace("_", "-")
    content = {
        "title": f"{swept.flag}: {', '.join(map(shown, swept.values))}",
        "sources": [source],
        "seeds": options.seed,
        "lines": {
            f"{setting} {shown(value)}": {
                "method": swept.method,
                "settings": others | {f"{swept.method}.{swept.setting}": value},
            }
            for value in swept.values
        },
        "quantities": list(QUANTITIES),
        "stereo_every": options.stereo_every,
        "video_scale": options.video_scale,
        "max_exposures": options.max_exposures,
    }
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)


def _others(swept: Swept, config: Config) -> dict[str, Value]:
    """What is not the default, of the method and of those that it asks."""
    found: dict[str, Value] = {}
    for name in with_asked([swept.method]):
        usual: Any = method(name).config()
        for field in fields(usual):
            value: Any = getattr(config.of(name), field.name)
            if value == getattr(usual, field.name) or (name, field.name) == (swept.method, swept.setting):
                continue
            if not isinstance(value, Value):
                raise InputError(f"a sweep cannot take --{name}.{field.name.replace('_', '-')}: restore its default")
            found[f"{name}.{field.name}"] = value
    return found
