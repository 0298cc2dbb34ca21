"""Formulas of the field: numbers in, numbers out; no mesh, no ray."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
