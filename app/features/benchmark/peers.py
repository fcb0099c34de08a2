"""What other programs reached on the same data, measured on two shared cores without a GPU.

Times are medians per frame in U (unit.py); t_err in the manner of KITTI over 5, 10, 20 and
40 m; ATE after alignment (SE(3) stereo, Sim(3) monocular). ORB-SLAM2 differs from run to run.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Peer:
    name: str
    unit_ratio: str = "-"
    """Median time per frame in U, on one thread where not told otherwise."""
    t_err_percent: str = "-"
    ate_m: str = "-"
    note: str = ""


PEERS: dict[tuple[str, str], tuple[Peer, ...]] = {
    ("kitti-06", "stereo"): (
        Peer("libviso2, default", "1.4", "0.98", "0.120"),
        Peer("libviso2, full size", "7.5", "0.87", "0.098"),
        Peer("ORB-SLAM2", "6.1", "0.67-0.75", "0.048-0.073", "one core; 2.6-3.5 on several"),
        Peer("an OpenCV tutorial", "7.7", "2.55", "0.394", "popular, in Python"),
        Peer("a prototype", "1.2", "1.02", "0.12", "Python, OpenCV and numba, window of 8 key frames"),
    ),
    ("kitti-06", "monocular"): (
        Peer("ORB-SLAM2", "1.3", "0.55-0.67", "0.020-0.036", "several threads"),
        Peer("libviso2", "2.3", "2.74", "0.236"),
        Peer("pycolmap 4.2", "43", "0.62", "0.022", "incremental, two threads"),
    ),
    ("kitti-00", "monocular"): (
        Peer("ORB-SLAM2", "1.4", "3.2-3.65", "0.71-0.85", "several threads"),
        Peer("pycolmap 4.2", "88", "4.75", "1.20", "incremental, two threads"),
        Peer("libviso2", "2.3", "11.9", "2.75", "6 frames failed"),
    ),
    ("euroc", "stereo"): (
        Peer("libviso2", note="drifts 17 mm in 5 s"),
        Peer("ORB-SLAM2", note="drifts 1 mm in 5 s"),
    ),
}
"""By source and method."""

PEERS_UNIT_MS = 11.2
WINDOW_PEERS = "peers per solve: Ceres 11.5-24 ms, fixed-lag smoothers 24-104 ms, gtsam 67-106 ms"
