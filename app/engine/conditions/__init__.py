"""Break points: expressions over the quantities of an exposure, in a closed grammar."""
