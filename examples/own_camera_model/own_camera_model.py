"""A camera model: the double sphere for fisheye lenses beyond 180 degrees (Usenko, Demmel and Cremers 2018).

The two coefficients of `distortion` are xi and alpha. Equation numbers are the paper's.
"""

import numpy as np

import ispom


class DoubleSphere(ispom.CameraModel):
    name = "double_sphere"
    counts = (2,)

    def project(self, camera, xyz_in_camera):
        x, y, denominator, seen = _parts(camera, xyz_in_camera)[:4]
        with np.errstate(divide="ignore", invalid="ignore"):
            uv = np.stack([camera.fx * x / denominator + camera.cx, camera.fy * y / denominator + camera.cy], axis=1)
        return np.where(seen[:, None], uv, np.nan)

    def unproject(self, camera, uv):  # equations 46 to 50
        xi, alpha = camera.distortion
        mx, my = (uv[:, 0] - camera.cx) / camera.fx, (uv[:, 1] - camera.cy) / camera.fy
        r2 = mx**2 + my**2
        valid = (1 - (2 * alpha - 1) * r2 >= 0) & np.isfinite(r2)
        r2 = np.where(valid, r2, 0.0)
        mz = (1 - alpha**2 * r2) / (alpha * np.sqrt(1 - (2 * alpha - 1) * r2) + 1 - alpha)
        inside = mz**2 + (1 - xi**2) * r2
        valid &= inside >= 0
        length = (mz * xi + np.sqrt(np.maximum(inside, 0))) / (mz**2 + r2)
        rays = np.stack([length * np.where(valid, mx, 0), length * np.where(valid, my, 0), length * mz - xi], axis=1)
        rays[~valid] = 0, 0, 1
        return rays / np.linalg.norm(rays, axis=1, keepdims=True), valid

    def jacobian(self, camera, xyz_in_camera):
        xi, alpha = camera.distortion
        x, y, denominator, seen, z1, d1, d2 = _parts(camera, xyz_in_camera)
        z, out = xyz_in_camera[:, 2], np.zeros((len(x), 2, 3))
        with np.errstate(divide="ignore", invalid="ignore"):
            # d1' = (x, y, z) / d1; z1 = xi d1 + z; d2' = (x + z1 xi x / d1, y + z1 xi y / d1, z1 (xi z / d1 + 1)) / d2
            by_z1 = np.stack([xi * x / d1, xi * y / d1, xi * z / d1 + 1], axis=1)
            by_d2 = (np.stack([x, y, np.zeros_like(z)], axis=1) + z1[:, None] * by_z1) / d2[:, None]
            by_denominator = alpha * by_d2 + (1 - alpha) * by_z1
            for row, (focal, value) in enumerate(((camera.fx, x), (camera.fy, y))):
                out[:, row] = -focal * (value / denominator**2)[:, None] * by_denominator
                out[:, row, row] += focal / denominator
        return np.where(seen[:, None, None], out, np.nan)


def _parts(camera, xyz):
    """x, y, the denominator (equations 40 to 42), which points are seen (43 to 45), z1, d1 and d2."""
    xi, alpha = camera.distortion
    x, y, z = xyz.T
    d1 = np.sqrt(x**2 + y**2 + z**2)
    z1 = xi * d1 + z
    d2 = np.sqrt(x**2 + y**2 + z1**2)
    w1 = alpha / (1 - alpha) if alpha <= 0.5 else (1 - alpha) / alpha
    w2 = (w1 + xi) / np.sqrt(2 * w1 * xi + xi**2 + 1)
    denominator = alpha * d2 + (1 - alpha) * z1
    return x, y, denominator, (z > -w2 * d1) & (denominator > 1e-9 * d1), z1, d1, d2


MODEL = DoubleSphere()
