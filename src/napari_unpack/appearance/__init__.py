"""How objects look: the master transfer function, interference, hues and tints.

Names are imported on first use, so that a plugin starts without loading networkx and numba.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
