"""Events of a run as Rerun entities, in files and in the live stream."""

from .allocators import spare_memory
from .without_pandas import spare_pandas

spare_memory()  # before the modules here are imported: those import Rerun, and their first arrays would bring pandas
spare_pandas()
