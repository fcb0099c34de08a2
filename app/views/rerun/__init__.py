"""Events of a run as Rerun entities, in files and in the live stream."""
