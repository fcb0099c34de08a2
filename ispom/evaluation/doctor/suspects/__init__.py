"""The table of suspects. A new one is an entry of a file here, and its name in the documentation."""

from __future__ import annotations

from ..finding import Suspect
from .calibration import CALIBRATION
from .images import IMAGES
from .sensors import SENSORS
from .times import TIMES
from .tracks import TRACKS

SUSPECTS: tuple[Suspect, ...] = (*TIMES, *IMAGES, *TRACKS, *SENSORS, *CALIBRATION)
"""All suspects in the order in which they are examined: the quick ones first."""
