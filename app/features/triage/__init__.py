"""`ispom triage`: every clip of a folder is run and diagnosed, and one page says which are fine, and what to do."""
