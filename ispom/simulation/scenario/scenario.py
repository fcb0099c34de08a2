"""A scenario: a scene, how one moves in it, other sensors, and faults; of the words after `sim:` or of a YAML file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import Field, dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from ispom.errors import InputError
from ispom.io.mapping import parse_yaml, read_mapping
from ispom.sensors import SENSOR_KINDS
from ispom.sensors.simulated import Scenery, SimulatedSensor
from ispom.settings import Range, from_plain, settings
from ispom.simulation.scenario.calibrations import (
    Unlevel,
    WrongBaseline,
    WrongLens,
    WrongMount,
    WrongPair,
    WrongShutter,
)
from ispom.simulation.scenario.fault import Clock, Dropped, Exchanged, Fault, Repeated
from ispom.simulation.scenario.images import Blocked, Darkness, Defocus, ExposureJumps, Rain
from ispom.simulation.scenario.spoilt import Fog, Jpeg, MotionBlur, MovingPatch, Noise, Smear
from ispom.types import Sequence

FAULTS: Mapping[str, type] = {
    "darkness": Darkness,
    "exposure-jumps": ExposureJumps,
    "defocus": Defocus,
    "blocked": Blocked,
    "rain": Rain,
    "motion-blur": MotionBlur,
    "fog": Fog,
    "smear": Smear,
    "object": MovingPatch,
    "noise": Noise,
    "jpeg": Jpeg,
    "dropped": Dropped,
    "repeated": Repeated,
    "exchanged": Exchanged,
    "clock": Clock,
    "wrong-lens": WrongLens,
    "wrong-baseline": WrongBaseline,
    "wrong-pair": WrongPair,
    "unlevel": Unlevel,
    "wrong-mount": WrongMount,
    "wrong-shutter": WrongShutter,
}
"""Faults by their name in files and addresses. All but `wrong-shutter` change any recording."""


@dataclass(frozen=True, kw_only=True)
class World:
    """The place, the motion and the cameras."""

    place: Literal["own", "city", "town", "indoor", "moon", "wall", "blank", "tiles", "tags"] = "own"
    """own: that of the scene; city: a street; town: streets around a block; indoor: corridor, stairs and hall; moon:
    craters; wall: one textured plane; blank: without texture; tiles: every 0.5 m the same; tags: a wall
    with AprilTags of 1.2 m."""
    motion: Literal["own", "flight", "drive", "loop", "walk", "still", "tiny-steps", "rotation", "pan", "sideways"] = (
        "own"
    )
    """own: that of the scene; flight: along the street; drive: the same, level and even; loop: around the town's block;
    walk: through the building; still; tiny-steps: fifty times slower; rotation: about the video camera's centre;
    pan: a full turn about it and back; sideways: along a wall."""
    route: str = ""
    """TUM file of poses world_from_rig, moved through from the first one on, instead of a motion."""
    mesh: str = ""
    """PLY, OBJ or glTF file with a texture or with colours, instead of a place; it needs a route."""
    duration_s: Annotated[float, Range(0, 600)] = 0.0
    """[s], from 0.1; 0: that of the scene."""
    motion_blur: bool = False
    """The shutter is open for 8 ms."""
    right_late_ms: Annotated[float, Range(-100, 100)] = 0.0
    """Delay of the right camera after the left one [ms]."""
    rolling_shutter_ms: Annotated[float, Range(0, 100)] = 0.0
    """Delay of the last row after the first one, in all cameras [ms]; times are those of the middle row."""
    width_px: Annotated[int, Range(0, 4096)] = 0
    """Width of all images, at the same fields of view; 0: that of the scene. From 64 on."""
    portrait: bool = False
    """Images are higher than wide: sides are exchanged, and with them the fields of view."""
    fisheye: bool = False
    """All cameras have fisheye lenses, with 1.5 times as wide an angle; the pair is rectified on opening."""
    cameras: Annotated[int, Range(0, 12)] = 0
    """Number of cameras in a ring that look outwards, instead of the video camera and the pair; 0: those of the
    scene."""
    vehicles: Annotated[int, Range(0, 40)] = 0
    """Number that drive in the city's street, at 5 to 10 m/s in both directions."""
    people: Annotated[int, Range(0, 200)] = 0
    """Number that walk on the city's pavements."""


@dataclass(frozen=True)
class Scenario:
    """A scene with a world, other sensors and faults."""

    scene: str
    """city, tiny ..."""
    seed: int | None
    """None: that of --seed."""
    world: World
    faults: tuple[tuple[str, Fault], ...] = ()
    """With their names, in the order in which they are applied."""
    sensors: tuple[SimulatedSensor, ...] = ()
    """Those that it has besides cameras, each once."""

    def sensed(self, sequence: Sequence, scenery: Scenery) -> Sequence:
        """Returns the sequence with what the other sensors measured."""
        if not self.sensors:
            return sequence
        rig = sequence.rig.changed(**{each.name: each.sensor() for each in self.sensors})
        found = [m for each in self.sensors for m in each.measured(scenery)]
        return replace(sequence, rig=rig).with_measurements(found)

    def on(self, sequence: Sequence, seed: int) -> Sequence:
        """Returns the sequence with all faults."""
        for _, fault in self.faults:
            sequence = fault.on(sequence, seed)
        return sequence

    @property
    def words(self) -> str:
        """Differences from the plain scene, for people; an empty text where there are none."""
        named = [*((each.name, each) for each in self.sensors), *self.faults]
        others = (f"{name} {', '.join(_changed(each))}".strip() for name, each in named)
        return ", ".join([*_changed(self.world), *others])


def simulated_sensors() -> dict[str, type]:
    """Returns the sensors that can be simulated, by their name in files and addresses: their kind, and their name in
    the rig."""
    return {name: kind.simulated for name, kind in SENSOR_KINDS.items().items() if kind.simulated is not None}


def scenario_of_words(text: str) -> Scenario:
    """Reads what follows `sim:`, as in `city?motion=drive&sensor=gnss:noise_m=1&fault=darkness:factor=0.1,from_s=3`.

    Raises InputError where it is invalid.
    """
    scene, _, query = text.partition("?")
    world, listed = dict[str, Any](), {"sensor": list[dict[str, Any]](), "fault": list[dict[str, Any]]()}
    for part in filter(None, query.split("&")):
        key, equals, value = part.partition("=")
        if not equals:
            raise InputError(f"sim:{text}: {part[:60]!r} is no setting: give such as motion=rotation or fault=darkness")
        if key in listed:
            name, _, chosen = value.partition(":")
            pairs = [pair.partition("=") for pair in filter(None, chosen.split(","))]
            listed[key].append({name: {k: _plain(v) for k, _, v in pairs}})
        else:
            world[key] = _plain(value)
    return _scenario(f"sim:{text}", {"scene": scene, **world, **{f"{key}s": value for key, value in listed.items()}})


def fault_of_words(text: str) -> Fault:
    """Reads a fault as in an address, such as `darkness:factor=0.1,from_s=3`. Raises InputError where it is invalid."""
    name, _, chosen = text.partition(":")
    pairs = [pair.partition("=") for pair in filter(None, chosen.split(","))]
    return _named(f"fault {text}", {name: {k: _plain(v) for k, _, v in pairs}}, FAULTS, "fault")[1]


def with_sensors(text: str, sensors: Iterable[Any]) -> str:
    """Returns the words after `sim:` with these simulated sensors instead of theirs."""
    scene, _, query = text.partition("?")
    parts = [part for part in query.split("&") if part and not part.startswith("sensor=")]
    for sensor in sensors:
        chosen = [f"{f.name}={str(getattr(sensor, f.name)).lower()}" for f in fields(sensor) if _differs(sensor, f)]
        parts.append(f"sensor={':'.join(filter(None, [sensor.name, ','.join(chosen)]))}")
    return "?".join(filter(None, [scene, "&".join(parts)]))


def scenario_of_file(path: Path) -> Scenario:
    """Reads a YAML file: scene, perhaps seed, the fields of `World`, and the lists `sensors` and `faults` of
    `name: {setting: value}`."""
    return _scenario(str(path), read_mapping(path))


def _scenario(where: str, content: Mapping[Any, Any]) -> Scenario:
    rest = dict(content)
    scene, seed = rest.pop("scene", None), rest.pop("seed", None)
    entries = {key: rest.pop(key, []) for key in ("sensors", "faults")}
    if not isinstance(scene, str):
        raise InputError(f"{where}: scene is {str(scene)[:40]!r}: give a name such as city")
    if seed is not None and (not isinstance(seed, int) or isinstance(seed, bool) or seed < 0):
        raise InputError(f"{where}: seed is {str(seed)[:40]!r}: give a whole number")
    for key, example in (("sensors", "{gnss: {noise_m: 1}}"), ("faults", "{darkness: {factor: 0.1}}")):
        if not isinstance(entries[key], list) or not all(isinstance(f, str | dict) for f in entries[key]):
            raise InputError(f"{where}: {key} is no list of {key}: give such as [{example}]")
    world = from_plain(World, rest, where)
    _check(world, where)
    faults = tuple(_named(where, f, FAULTS, "fault") for f in entries["faults"])
    sensors = [_named(where, f, simulated_sensors(), "sensor") for f in entries["sensors"]]
    if len({name for name, _ in sensors}) < len(sensors):
        raise InputError(f"{where}: a sensor is there twice: give each kind once")
    return Scenario(scene, seed, world, faults, tuple(sensor for _, sensor in sensors))


def _named(where: str, entry: str | dict[Any, Any], known: Mapping[str, type], what: str) -> tuple[str, Any]:
    """Returns name and value of `darkness`, or of `{darkness: {factor: 0.1}}`."""
    named = {entry: {}} if isinstance(entry, str) else entry
    name, chosen = next(iter(named.items()), ("", {}))
    if len(named) != 1 or name not in known:
        raise InputError(f"{where}: {str(name)[:40]!r} is no {what}: choose from {', '.join(known)}")
    value = from_plain(known[name], chosen if chosen is not None else {}, f"{where}: {name}")
    _check(value, f"{where}: {name}")
    return name, value


def _check(values: Any, where: str) -> None:
    """Raises InputError where a value is out of its range."""
    for setting in settings(type(values)):
        value, limits = getattr(values, setting.name), setting.range
        if limits is not None and not limits.low <= value <= limits.high:
            hint = f"give a value from {limits.low:g} to {limits.high:g}"
            raise InputError(f"{where}: {setting.name} is {value:g}, {hint}")


def _plain(word: str) -> Any:
    """Returns a number, true, false or a word."""
    try:
        value = parse_yaml(word, word)
    except InputError:
        return word
    return value if isinstance(value, bool | int | float) else word


def _differs(values: Any, field: Field[Any]) -> bool:
    """Whether a value is not its default."""
    return getattr(values, field.name) != field.default


def _changed(values: Any) -> list[str]:
    differing = [f.name for f in fields(values) if _differs(values, f)]
    return [f"{name} {getattr(values, name)}" for name in differing]
