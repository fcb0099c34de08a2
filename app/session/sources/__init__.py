"""Sources that may be opened, and how they are opened."""
