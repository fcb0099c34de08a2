"""The modern integrated method; its steps are the file names."""
