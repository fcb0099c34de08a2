"""Lessons: Markdown files that set the page, ask, and reveal by running; what is right is computed from the runs."""
