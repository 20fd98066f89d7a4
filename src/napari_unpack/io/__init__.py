"""Files: volumes of many formats, tables, images and movies.

Names are imported on first use, so that napari can ask for a reader without loading numba.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
