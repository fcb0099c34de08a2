"""Loop closures: recognise an earlier place after a long path, and correct all poses since."""
