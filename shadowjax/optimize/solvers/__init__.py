"""Minimisers: bounded multistart search, least squares and descent on meshes."""
