"""Equations of the multi-depth source."""
