"""The command `ispom`: `commands` lists its commands."""
