"""Equations of the warping source."""
