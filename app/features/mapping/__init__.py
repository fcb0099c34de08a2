"""`ispom map`: a dense model of what a run saw, and a laser's points placed by its poses."""
