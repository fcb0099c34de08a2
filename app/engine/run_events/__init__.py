"""Events of a run: what a person should look at, found in its frames. Each kind is one file of `kinds`."""
