"""Images and ray queries of volumes: rendering, object-ID layers, occlusion, picking.

Names are imported on first use, so that a plugin starts without loading numba.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
