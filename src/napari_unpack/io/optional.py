"""Packages that only some formats need."""

from __future__ import annotations

import importlib
from typing import Any


def needed(module: str, package: str, purpose: str) -> Any:
    """Import an optional package, or say what to install.

    Parameters
    ----------
    module : str
        What to import.
    package : str
        What to install.
    purpose : str
        What it is needed for, such as "reading NIfTI".

    Raises
    ------
    ImportError
        If it is not there.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError(
            f"{purpose} needs {package}, which is not installed; "
            f"run: pip install {package} (or 'napari-unpack[formats]' for every format)"
        ) from error
