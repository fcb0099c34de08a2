"""The integration, step by step: what is drawn at each stage, and its numbers."""
