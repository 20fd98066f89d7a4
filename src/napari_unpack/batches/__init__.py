"""Many scans at once: inputs, the work on one scan, a Dask cluster, and the report of a run.

Names are imported on first use, so that `--help` comes without loading numba or dask.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
