"""Audits what is compared: whether an estimate and a reference disagree because the question is wrong.

A wrong clock, other axes, inverse poses, another body or another unit change all errors, and look like errors of the
method. Each module answers one question; `auditor` asks them all, and names only what explains much on poses that its
parameters were not fitted to. Nothing is corrected here.
"""
