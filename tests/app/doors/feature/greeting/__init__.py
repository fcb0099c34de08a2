"""A feature of a test: it keeps how often somebody was greeted."""
