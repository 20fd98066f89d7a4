"""Volume to labels by a network and classifiers, or by the paper's recursive cuts; evaluation.

Names are imported on first use, so that a batch starts without loading pandas and numba.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
