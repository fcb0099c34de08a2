"""A finished run as a folder of files that any web server shows, without Python."""
