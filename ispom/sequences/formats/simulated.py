"""`sim:NAME`: the simulated experiment (paper, section 6.4), rendered on demand and stored on disk."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.io.files import expanded
from ispom.sequences.address import MAX_SEED
from ispom.sequences.formats.scenario import looks_like_scenario
from ispom.sequences.rectification import Rectification, remapped
from ispom.simulation.cameras import Timing
from ispom.simulation.motions import Route, motion_of, route_name
from ispom.simulation.places.meshes import mesh_name
from ispom.simulation.rendering.cache import AheadRenderer, ImageCache, default_folder, source_key
from ispom.simulation.rendering.process import render_pool
from ispom.simulation.scenario.scenario import Scenario, World, scenario_of_file, scenario_of_words
from ispom.simulation.scenario.sensors import Scenery
from ispom.simulation.source import Source
from ispom.types import Frame, Image, Measurement, Rig, Sequence, Trajectory


@dataclass(frozen=True)
class Preset:
    """The scene of a name."""

    scale: float
    """Scale of the images: 1 is 640x480 video and 1280x960 stereo."""
    duration_s: float
    longest_s: float = 20.0
    place: str = "city"
    motion: str = "flight"
    cameras: int = 0
    """Number of cameras in a ring, instead of the video camera and the pair."""

    def rendered(self, world: World) -> tuple[str, str, int, int, int, int, int, bool, bool, int]:
        """Returns the renderer's arguments from `Source.place` on: those of the world, with this scene's as defaults.

        Raises InputError for missing files, and for options that the place does not have.
        """
        place = self.place if world.place == "own" else world.place
        motion = self.motion if world.motion == "own" else world.motion
        if (world.vehicles or world.people) and place != "city":
            raise InputError(f"vehicles and people are in the city only: give place=city, not {place or 'a mesh'}")
        if 0 < world.width_px < MIN_WIDTH_PX:
            raise InputError(f"width_px is {world.width_px}, give a value from {MIN_WIDTH_PX} to 4096, or 0")
        if world.mesh and not world.route:
            raise InputError("a mesh needs a route through it: give route=FILE, poses world_from_rig as a TUM file")
        return (
            mesh_name(world.mesh) if world.mesh else place,
            route_name(world.route) if world.route else motion,
            round(1e6 * world.right_late_ms),
            round(1e6 * world.rolling_shutter_ms),
            world.vehicles,
            world.people,
            world.width_px,
            world.portrait,
            world.fisheye,
            world.cameras or self.cameras,
        )

    def length_s(self, world: World) -> tuple[float, float]:
        """Returns the duration [s], and the longest possible one."""
        if not world.route:
            return self.duration_s, self.longest_s
        whole_s = Route(route_name(world.route)).duration_s
        return min(whole_s, LONGEST_ROUTE_S), min(whole_s, LONGEST_ROUTE_S)


_PLAIN = World()
LONGEST_ROUTE_S = 600.0
"""Longest duration of a user's route."""
MIN_WIDTH_PX = 64
"""Least width of video images."""
RING_SIZES = (5, 6, 8)
"""Numbers of cameras of the named rings."""
PRESETS = {
    "city": Preset(1.0, 20.0),
    "tiny": Preset(0.5, 3.0),
    "town": Preset(1.0, 85.0, 180.0, "town", "loop"),
    "indoor": Preset(1.0, 30.0, 30.0, "indoor", "walk"),
    "moon": Preset(1.0, 30.0, 60.0, "moon"),
    **{f"ring{count}": Preset(1.0, 10.0, cameras=count) for count in RING_SIZES},
}


def open_words(text: str, seed: int, cache_dir: Path | None = None) -> Sequence:
    """Opens `sim:TEXT`: a scene, optionally `?` with motion, faults and other options, and `#` with a seed.

    `cache_dir` replaces the user's cache folder. Raises InputError for an invalid text.
    """
    return open_scenario(*_of_words(text, seed), cache_dir)


def open_scenario_file(path: Path, seed: int) -> Sequence:
    """Opens the scenario of a YAML file, with its seed if it has one. Raises InputError for an invalid file."""
    return open_scenario(*_of_file(path, seed))


def rendered_source(address: str, seed: int) -> Source | None:
    """Returns place and motion of a simulation, from its `sim:TEXT` or scenario file; None for another source.

    Raises InputError for an invalid text or file.
    """
    if address.startswith("sim:"):
        scenario, seed = _of_words(address.removeprefix("sim:"), seed)
    elif looks_like_scenario(expanded(address)):
        scenario, seed = _of_file(expanded(address), seed)
    else:
        return None
    preset = PRESETS[scenario.scene]
    return Source(seed, scenario.world.motion_blur, preset.scale, *preset.rendered(scenario.world))


def _of_words(text: str, seed: int) -> tuple[Scenario, int]:
    words, _, own_seed = text.partition("#")
    if own_seed and not (own_seed.isdecimal() and len(own_seed) <= len(str(MAX_SEED)) and int(own_seed) <= MAX_SEED):
        raise InputError(f"sim:{text}: after # comes a seed, a whole number up to {MAX_SEED}: give sim:{words}#3")
    return _seeded(scenario_of_words(words), int(own_seed or seed), bool(own_seed))


def _of_file(path: Path, seed: int) -> tuple[Scenario, int]:
    return _seeded(scenario_of_file(path), seed)


def _seeded(scenario: Scenario, seed: int, chosen: bool = False) -> tuple[Scenario, int]:
    """Returns the scenario and its seed: its own one, unless it has none or another is `chosen`."""
    return scenario, seed if chosen or scenario.seed is None else scenario.seed


def open_scenario(scenario: Scenario, seed: int, cache_dir: Path | None = None) -> Sequence:
    """Opens the scenario's scene with its motion, cameras and faults. Raises InputError for an unknown scene."""
    world, preset = scenario.world, PRESETS.get(scenario.scene)
    length_s = world.duration_s or (preset and preset.length_s(world)[0])
    sequence = open_simulated(scenario.scene, seed, cache_dir, world.motion_blur, length_s, world)
    if scenario.sensors:
        source = Source(
            seed, world.motion_blur, PRESETS[scenario.scene].scale, *PRESETS[scenario.scene].rendered(world)
        )
        path = motion_of(source.motion, seed)
        sequence = scenario.sensed(sequence, Scenery(path.pose_at, sequence.times_ns, lambda: source.scene, seed))
    if not scenario.words:
        return sequence
    named = replace(sequence, name=f"{sequence.name}, {scenario.words}")
    return replace(scenario.on(named, seed), notes=(*sequence.notes, f"scenario: {scenario.words}"))


def open_simulated(
    name: str,
    seed: int = 0,
    cache_dir: Path | None = None,
    motion_blur: bool = False,
    duration_s: float | None = None,
    world: World = _PLAIN,
) -> Sequence:
    """Returns the simulated sequence `name`: "city", "tiny" (the same place, small images, 3 s: for tests), "town" ...

    World axes: x right, y down, z along the street; the ground is at y = 0. `world` replaces place and motion,
    `cache_dir` the user's cache folder, and `duration_s` [s] the preset's. Raises InputError for an unknown name, and
    for a duration that is too long for the scene.
    """
    if name not in PRESETS:
        raise InputError(
            f"there is no simulated sequence sim:{name}, choose one of {', '.join(f'sim:{n}' for n in PRESETS)}"
        )
    preset = PRESETS[name]
    duration_s = preset.duration_s if duration_s is None else duration_s
    longest_s = preset.length_s(world)[1]
    if not 0.1 <= duration_s <= longest_s:
        raise InputError(f"sim:{name} cannot last {duration_s:g} s, give a duration from 0.1 to {longest_s:g} s")
    world_settings = preset.rendered(world)
    shaping = (seed, motion_blur, preset.scale)
    source = Source(*shaping, *world_settings)
    stamps = Timing(duration_s).exposures(source.ring > 0)
    rig, rectified = _rectified(source.rig)
    if world.right_late_ms:
        rig = rig.changed(pair_sigma=None)
    path = motion_of(source.motion, seed)
    other = () if world_settings == PRESETS["city"].rendered(_PLAIN) else world_settings
    libraries = [version(name) for name in ("numpy", "opencv-python-headless")]
    ahead = AheadRenderer(
        [f"{time_ns:012d}_{kind}" for time_ns, kind in stamps],
        lambda i, threads: render_pool().render(*shaping, *stamps[i], threads, *other),
        ImageCache.open(cache_dir or default_folder(), source_key(*shaping, *libraries, *other)),
    )

    def load(i: int) -> Measurement:
        (time_ns, kind), image = stamps[i], ahead.get(i)
        if kind == "video":
            return Frame.video(time_ns, image)
        if kind == "cameras":
            return Frame(time_ns, dict(zip(rig.cameras, np.split(image, source.ring), strict=True)))
        return Frame.stereo(time_ns, *rectified(*np.split(image, 2)))

    return Sequence(
        f"sim:{name} seed {seed}" + (", motion blur" if motion_blur else ""),
        rig,
        np.array([t for t, _ in stamps], np.int64),
        tuple(kind for _, kind in stamps),
        load,
        Trajectory.of([(t, path.pose_at(t)) for t, _ in stamps]),
        ("simulated: rendered images with sensor noise, exact truth",),
        ahead.prepare,
    )


def _rectified(rig: Rig) -> tuple[Rig, Callable[[Image, Image], tuple[Image, Image]]]:
    """Returns the rig with its pair rectified, and the function that rectifies two images."""
    if not rig.has_stereo or rig.camera("left").lens != "fisheye":
        return rig, lambda *images: images
    left, right = rig.camera("left"), rig.camera("right")
    rectification = Rectification.of(left, right, rig.rig_from_right.inverse() @ rig.rig_from_left)
    rectified_rig = rig.changed(left=rectification.camera, right=rectification.camera)
    return rectified_rig, lambda a, b: (remapped(a, rectification.left_maps), remapped(b, rectification.right_maps))
