"""Formulas of the field: numbers in, numbers out; no mesh, no ray."""
