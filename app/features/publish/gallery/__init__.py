"""Several published runs on one page, which has the Rerun viewer once: the lessons, and ways to fail."""
