"""Events of a run as Rerun entities, in files and in the live stream."""

from .without_pandas import spare_pandas

spare_pandas()  # before the modules here are imported: their first arrays would bring it
