"""The command `ispom`: one file per command in `commands`."""
