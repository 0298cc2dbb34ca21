"""The ledger of equations: every formula of the sources next to independent routes to its value."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
