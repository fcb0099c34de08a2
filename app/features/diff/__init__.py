"""`ispom diff`: where two runs part, and what parts first."""
