"""shadowjax: a differentiable, analytical reference for shadow maps on JAX.

Names and packages load when they are first asked for: a command line must answer `--help`, bad options and signals
before JAX is imported, which takes a second.
"""

import lazy_loader

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
