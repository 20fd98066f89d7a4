"""The packages of the extra `batch`, or a sentence that says what to install."""

from __future__ import annotations

import importlib
from typing import Any


def needed_for_batches(module: str) -> Any:
    """Import a package that only batches need.

    Parameters
    ----------
    module : str
        "distributed", "pyarrow", or a part of one.

    Raises
    ------
    ImportError
        If it is not there; the message says what to install.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError(
            f"work on many scans needs {module.split('.')[0]}, which is not installed; "
            "run: pip install 'napari-unpack[batch]'"
        ) from error
