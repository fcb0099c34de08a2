"""Files with `KINDS` of events; a new kind is a new file, or one more in a file."""
