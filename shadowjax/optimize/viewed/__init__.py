"""Optimal parameters from what cameras see: bias, filters, near distances and splits."""
