"""The doctor: which cause explains a bad stretch of a recording, by what the images themselves say. No ground truth,
but where a setting of a run is judged."""
