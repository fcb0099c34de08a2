"""Images of a target: opened, chosen, filmed or simulated, and what is detected in them."""
