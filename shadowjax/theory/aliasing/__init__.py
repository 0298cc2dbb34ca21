"""Perspective aliasing error of warped shadow maps, and the parameters that minimise it."""
