"""Play, pause, step, seek and loop."""
