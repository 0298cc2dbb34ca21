"""Depth maps and what is made of them: blurs, mip chains, summed areas, and lookups."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
