"""All that faces the user: command line, viser and Rerun. Installed as `ispom_app`."""
