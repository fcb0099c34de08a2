"""The branches of a run: what each is, how they compare, and their runs."""
