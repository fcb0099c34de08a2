"""The modern monocular method; its steps are the file names."""
