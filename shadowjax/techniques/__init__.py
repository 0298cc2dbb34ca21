"""Shadow techniques: each is built for a mesh, a light and a camera, then gives visibility."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
