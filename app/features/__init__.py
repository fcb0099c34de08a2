"""Capabilities that a person sees, each in a folder: its values, commands, panel, templates and tests."""
