"""The modern stereo method; the file names are its steps."""
