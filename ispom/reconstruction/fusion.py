"""Depth images with poses -> one surface: a truncated signed distance in sparse voxel blocks (Curless and Levoy 1996;
Open3D's VoxelBlockGrid, Dong et al. 2021)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.meshes import open3d
from ispom.reconstruction.depth import Depth
from ispom.reconstruction.model import Mesh, Points, without_crumbs, without_outliers
from ispom.types import Camera, Image

BLOCK = 8
"""Voxels along a side of a block."""
BYTES_PER_VOXEL = 20
"""Distance, weight and three of colour."""


@dataclass(frozen=True)
class FusionSettings:
    """Resolution, memory and filters of the fusion."""

    voxel_m: float
    """Side of a voxel, in the unit of depths and poses: [m], or the unit of a method."""
    max_gb: float = 4.0
    """Memory of the voxels; a place that needs more raises an InputError with a size that fits."""
    truncation_voxels: float = 6.0
    """Distances from a surface beyond this are ignored."""
    min_looks: float = 2.0
    """A voxel observed in fewer images is no surface."""
    min_triangles: int = 200
    """Least number of triangles of a connected part of the mesh."""


class Fusion:
    """Fuses depth images; memory grows with the observed surface, not with the number of images."""

    def __init__(self, settings: FusionSettings) -> None:
        o3d = open3d()
        self._core, self._image = o3d.core, o3d.t.geometry.Image
        self._settings, self._looks, self._blocks = settings, 0, 0
        self._grid = o3d.t.geometry.VoxelBlockGrid(
            attr_names=("tsdf", "weight", "color"),
            attr_dtypes=(self._core.float32,) * 3,
            attr_channels=((1), (1), (3)),
            voxel_size=settings.voxel_m,
            block_resolution=BLOCK,
            block_count=10_000,
        )

    def add(self, depth: Depth, image: Image, camera: Camera, world_from_camera: Pose, max_depth_m: float) -> None:
        """Adds z (H, W), 0 where unknown, of an RGB or grey image of a camera without distortion.

        Raises InputError where the place is too large for its voxels.
        """
        if not depth.any():
            return
        rgb = np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image
        # Open3D counts pixels from the corner of the first one.
        shift = np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
        intrinsic = self._core.Tensor(camera.matrix + shift)
        extrinsic = self._core.Tensor(world_from_camera.inverse().matrix)
        seen = self._image(self._core.Tensor.from_numpy(np.ascontiguousarray(depth)))
        colour = self._image(self._core.Tensor.from_numpy(np.ascontiguousarray(rgb, np.float32) / np.float32(255)))
        around = (1.0, max_depth_m, self._settings.truncation_voxels)
        blocks = self._grid.compute_unique_block_coordinates(seen, intrinsic, extrinsic, *around)
        self._require_room()
        self._grid.integrate(blocks, seen, colour, intrinsic, intrinsic, extrinsic, *around)
        self._looks += 1

    def mesh(self) -> Mesh:
        """Returns the surface with normals and colours. Raises InputError where none was observed often enough."""
        triangles = None if not self._looks else self._grid.extract_triangle_mesh(self._settings.min_looks)
        if triangles is None or not len(triangles.triangle.indices):
            raise InputError("no surface was seen in two images: give a run with motion on images of textured places")
        mesh = without_crumbs(triangles, self._settings.min_triangles)
        if not len(mesh):
            raise InputError("no surface holds together: give a larger --voxel-m")
        return mesh

    def cloud(self) -> Points:
        """Returns the points with normals and colours; call it after `mesh`."""
        return without_outliers(self._grid.extract_point_cloud(self._settings.min_looks))

    def _require_room(self) -> None:
        count = int(self._grid.hashmap().size())
        gb = count * BLOCK**3 * BYTES_PER_VOXEL / 1e9
        if gb > self._settings.max_gb:
            fitting = self._settings.voxel_m * 1.5
            raise InputError(
                f"a map with voxels of {self._settings.voxel_m:g} needs more than {self._settings.max_gb:g} GB: "
                f"give a larger --voxel-m, such as {fitting:.2g}, a smaller --max-depth-m, or a larger --memory-gb"
            )
