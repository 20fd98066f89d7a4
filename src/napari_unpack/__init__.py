"""See into packed things: segment, colour and virtually unpack a CT volume.

The public API of the project. Names are imported on first use, so that napari can read the
plugin's manifest, and `import napari_unpack` return, without loading numba or scipy.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
