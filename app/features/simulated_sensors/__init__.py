"""Runs of a simulation with other errors of its IMU, GNSS, wheels and laser scanner."""
