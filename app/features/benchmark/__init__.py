"""`ispom bench`: accuracy, speed and memory of every method and variant, and the figures of other programs."""
