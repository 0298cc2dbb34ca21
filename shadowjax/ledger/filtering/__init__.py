"""Equations of the filtering source."""
