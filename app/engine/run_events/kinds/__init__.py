"""Files with `KINDS` of events."""
