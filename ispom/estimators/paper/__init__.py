"""The three methods exactly as the paper prints them (sections 6.1 to 6.3)."""
