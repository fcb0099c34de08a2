"""The mesh that `ispom map` made of a run, in viser's scene."""

from __future__ import annotations

import logging

import viser

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.files import read_bytes
from ispom.io.meshes import GLTF_FROM_WORLD

from ...engine.run_folder.made_map import MadeMap

MOST_BYTES = 256 << 20
"""Of a mesh that is sent to a browser; `ispom map` writes less than a tenth of it."""
log = logging.getLogger(__name__)


class MapScene:
    """Below its method's node, so that it is where that method's world is. Sent when it is wanted first."""

    def __init__(self, api: viser.SceneApi, made: MadeMap | None) -> None:
        self._api, self._made = api, made
        self._mesh: viser.GlbHandle | None = None

    def show(self, hidden: frozenset[str]) -> None:
        """With the layer, and with its method."""
        if self._made is None:
            return
        wanted = not hidden & {"map", self._made.method}
        if wanted and self._mesh is None:
            self._mesh = self._added(self._made)
        if self._mesh is not None and self._mesh.visible != wanted:
            self._mesh.visible = wanted

    def _added(self, made: MadeMap) -> viser.GlbHandle | None:
        try:
            content = read_bytes(made.preview, MOST_BYTES)
        except InputError as error:  # the run is shown without
            log.warning("%s", error)
            self._made = None
            return None
        world_from_gltf: Pose = GLTF_FROM_WORLD.inverse()
        return self._api.add_glb(f"/{made.method}/map", content, wxyz=world_from_gltf.wxyz, cast_shadow=False)
