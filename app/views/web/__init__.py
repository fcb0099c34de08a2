"""The page: one server on one port, with the gateway to viser, Rerun and the recordings."""
