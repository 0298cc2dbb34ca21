"""Parameter sets of engines in use, by name: what they say, what of it runs here, and what has no counterpart."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
