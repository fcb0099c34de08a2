"""Tests of the plots of the time dock."""
