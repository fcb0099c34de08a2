"""Without the SDK of the protocol, an extra, there is nothing to test."""

from importlib.util import find_spec

collect_ignore_glob = [] if find_spec("mcp") else ["test_*.py"]
