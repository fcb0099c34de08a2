"""A doubt: one sentence with a key by which programs and tests know it."""

from __future__ import annotations

from collections.abc import Iterable

DOUBTS = {
    "time_unit": "times in milliseconds in `time_s`, or microseconds in `time_ns`",
    "outside_images": "measurements outside the images' time, and images without them",
    "imu_swapped": "columns of gyroscope and accelerometer exchanged",
    "imu_all_zero": "a gyroscope or an accelerometer that measures 0 only",
    "imu_hole": "no sample of the IMU for half a second or longer",
    "imu_slow": "fewer than 9.5 samples per second",
    "gyroscope_in_degrees": "angular velocities in degrees per second",
    "accelerometer_in_g": "accelerations in units of gravity",
    "accelerometer_too_large": "accelerations in mm/s^2, or the converter's counts",
    "accelerometer_without_gravity": "accelerations from which gravity is subtracted",
    "latitude_longitude_swapped": "latitude and longitude exchanged",
    "latitude_in_radians": "latitude and longitude in radians",
    "latitude_in_minutes": "latitude and longitude as DDMM.MM",
    "latitude_impossible": "a latitude beyond 90 degrees",
    "height_impossible": "a height outside the atmosphere, as of millimetres",
    "gnss_null_fix": "some fixes at latitude 0, longitude 0, which receivers write without a fix",
    "gnss_all_zero": "a receiver that gives 0, 0, 0 only",
    "gnss_jump": "fixes that are too far apart for any vehicle",
    "gnss_utm": "positions in UTM instead of a local frame",
    "gnss_earth_centred": "positions from the centre of the Earth instead of a local frame",
    "gnss_far": "positions far from the origin of the local frame",
    "gnss_mirrored": "a path that turns to the other side than the IMU: latitude and longitude (or x and y) exchanged",
    "sigma_large": "standard deviations that make fixes useless",
    "sigma_small": "standard deviations that no receiver reaches",
    "wheel_unit": "distances in millimetres or in ticks",
    "wheel_cumulative": "distances since the start instead of since the row before",
    "wheel_turn_in_degrees": "rotations in degrees",
    "wheel_all_zero": "a wheel that does not turn while GNSS moves",
    "mount_far": "a mount in millimetres, or an impossible one",
    "mount_quaternion": "a quaternion in the order w, x, y, z",
    "focal_long": "a focal length far longer than usual",
    "focal_short": "a focal length far shorter than usual",
    "focal_aspect": "two focal lengths as of pixels that are not square",
    "centre_swapped": "cx and cy exchanged",
    "centre_far": "a principal point far from the image's middle",
    "distortion_large": "a coefficient of the distortion that bends the image by half or more",
    "distortion_folds": "a distortion that cannot be undone within the image",
    "images_black": "black images",
    "images_frozen": "images that are all the same",
    "images_interlaced": "images of two fields",
    "images_transparent": "images that are transparent",
    "pair_unlike": "two images in one, or a pair that is exchanged, turned, mirrored, out of level or of two moments",
    "images_title": "a title or another still image within a film",
    "images_cut": "a cut within a film, or images that are missing while its times go on",
    "images_repeated": "images that are repeated, as of a webcam that is read too often",
}
"""What is found, by key."""


class Doubt(str):
    """One sentence about a value that is likely a mistake: what, where, and what to do, with the figure."""

    key: str
    """One of DOUBTS."""

    def __new__(cls, key: str, sentence: str) -> Doubt:
        """Raises KeyError for a key that is none of DOUBTS."""
        DOUBTS[key]
        doubt = super().__new__(cls, sentence)
        doubt.key = key
        return doubt

    def __getnewargs__(self) -> tuple[str, str]:  # type: ignore[override]
        return self.key, str(self)


def keys_of(notes: Iterable[str]) -> set[str]:
    """Returns the keys of the doubts among notes."""
    return {note.key for note in notes if isinstance(note, Doubt)}
