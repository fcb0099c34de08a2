"""`ispom bench`: accuracy, speed and memory of every method and variant, beside what other programs reached."""
