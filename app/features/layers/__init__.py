"""Which parts of the stage are drawn, and what the colours mean."""
