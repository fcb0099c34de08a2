"""viser's part of the page: the panels and the 3-D scene."""
