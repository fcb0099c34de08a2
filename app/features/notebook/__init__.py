"""Run folders for notebooks, and the view of a run in a cell: the entry point of `ispom.run_folders`."""
