"""`sim:NAME`: the simulated experiment (paper, section 6.4), rendered when asked for and kept on disk."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from ispom.errors import InputError
from ispom.sequences.address import MAX_SEED
from ispom.simulation.ahead import AheadRenderer
from ispom.simulation.cache import ImageCache, default_folder, source_key
from ispom.simulation.cameras import Timing, simulated_rig
from ispom.simulation.motions import motion_of
from ispom.simulation.process import render_pool
from ispom.simulation.scenario.scenario import Scenario, World, scenario_of_file, scenario_of_words
from ispom.types import Exposure, Sequence, StereoPair, Trajectory, VideoFrame


@dataclass(frozen=True)
class Preset:
    """What a name stands for."""

    scale: float
    """Of the images: 1 is 640x480 video and 1280x960 stereo."""
    duration_s: float
    longest_s: float = 20.0
    place: str = "city"
    motion: str = "flight"

    def rendered(self, world: World) -> tuple[str, str, int]:
        """What the renderer is told of a world: of this scene where it says nothing else."""
        place, motion = (self.place, self.motion)
        return (
            place if world.place == "own" else world.place,
            motion if world.motion == "own" else world.motion,
            round(1e6 * world.right_late_ms),
        )


_PLAIN = World()
PRESETS = {"city": Preset(1.0, 20.0), "tiny": Preset(0.5, 3.0), "town": Preset(1.0, 85.0, 180.0, "town", "loop")}


def open_words(text: str, seed: int) -> Sequence:
    """What `sim:TEXT` means: a scene, perhaps `?` with motion, faults and the like, perhaps `#` with its own seed.

    InputError where any of it is wrong.
    """
    words, _, own_seed = text.partition("#")
    if own_seed and not (own_seed.isdecimal() and len(own_seed) <= len(str(MAX_SEED)) and int(own_seed) <= MAX_SEED):
        raise InputError(f"sim:{text}: after # comes a seed, a whole number up to {MAX_SEED}: give sim:{words}#3")
    return open_scenario(scenario_of_words(words), int(own_seed or seed))


def open_scenario_file(path: Path, seed: int) -> Sequence:
    """The scenario of a YAML file, with its own seed where it names one; InputError where the file is wrong."""
    scenario = scenario_of_file(path)
    return open_scenario(scenario, seed if scenario.seed is None else scenario.seed)


def open_scenario(scenario: Scenario, seed: int, cache_dir: Path | None = None) -> Sequence:
    """The scene as it moves and is seen in the scenario, with its faults; InputError for a scene that is none."""
    world, preset = scenario.world, PRESETS.get(scenario.scene)
    sequence = open_simulated(
        scenario.scene, seed, cache_dir, world.motion_blur, world.duration_s or (preset and preset.duration_s), world
    )
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
    """The simulated sequence `name`: "city", "tiny" (the same place, small images, 3 s: for tests), or "town".

    `world` says where and how one moves, instead. World: x right, y down, z along the street, ground at y = 0.
    `cache_dir` replaces the user's cache folder, `duration_s` [s] the preset's. InputError for an unknown name, and for
    a duration that the scene is too small for.
    """
    if name not in PRESETS:
        raise InputError(
            f"there is no simulated sequence sim:{name}, choose one of {', '.join(f'sim:{n}' for n in PRESETS)}"
        )
    preset = PRESETS[name]
    duration_s = preset.duration_s if duration_s is None else duration_s
    if not 0.1 <= duration_s <= preset.longest_s:
        raise InputError(f"sim:{name} cannot last {duration_s:g} s, give a duration from 0.1 to {preset.longest_s:g} s")
    asked = preset.rendered(world)
    rig, path, stamps = simulated_rig(preset.scale), motion_of(asked[1], seed), Timing(duration_s).exposures()
    other = () if asked == PRESETS["city"].rendered(_PLAIN) else asked
    shaping = (seed, motion_blur, preset.scale)
    libraries = [version(name) for name in ("numpy", "opencv-python-headless")]
    ahead = AheadRenderer(
        [f"{time_ns:012d}_{kind}" for time_ns, kind in stamps],
        lambda i, threads: render_pool().render(*shaping, *stamps[i], threads, *other),
        ImageCache.open(cache_dir or default_folder(), source_key(*shaping, *libraries, *other)),
    )

    def load(i: int) -> Exposure:
        (time_ns, kind), image = stamps[i], ahead.get(i)
        if kind == "video":
            return VideoFrame(time_ns, image)
        left, right = np.split(image, 2)
        return StereoPair(time_ns, left, right)

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
