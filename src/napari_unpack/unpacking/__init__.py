"""Which objects can leave, in which order, along which path, and where they wait.

Names are imported on first use, so that a batch starts without loading networkx.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
