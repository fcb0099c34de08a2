"""What may be opened, and how."""
