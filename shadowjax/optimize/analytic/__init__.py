"""Optimal parameters from closed forms: near distances and split planes of a view."""
