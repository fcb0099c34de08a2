"""What moved a pose: the problem that gave it, solved again in thought without a part of what it was made of."""
