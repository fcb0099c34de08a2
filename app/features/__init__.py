"""Capabilities that a person sees, one folder each."""
