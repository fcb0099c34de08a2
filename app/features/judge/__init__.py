"""`ispom judge`: poses of any program against the images of their recording."""
