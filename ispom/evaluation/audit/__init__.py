"""Audits a comparison: whether an estimate and a reference disagree because they are compared wrongly.

A wrong clock, other axes, inverse poses, another body or another unit change all errors, and look like errors of the
method. Each module tests one such mistake. `auditor` tests all of them, and names only those that explain much on poses
to which their parameters were not fitted. Nothing is corrected here.
"""
