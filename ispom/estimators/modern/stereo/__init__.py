"""The modern stereo method; its steps are the file names."""
