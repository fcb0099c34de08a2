"""Run folders for notebooks: the entry point of `ispom.run_folders`."""
