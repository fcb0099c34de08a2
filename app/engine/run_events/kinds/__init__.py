"""One file per kind of event, each with a `KIND`."""
