"""The transport among the controls."""
