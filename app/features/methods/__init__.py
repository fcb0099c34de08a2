"""The methods that run, and their settings."""
