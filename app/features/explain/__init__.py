"""Explain: what each method did at a frame, the verdict first."""
