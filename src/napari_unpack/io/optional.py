"""Packages that only some work needs."""

from __future__ import annotations

import importlib
from typing import Any


def needed(module: str, purpose: str, extra: str = "formats") -> Any:
    """Import an optional package, or say what to install.

    Parameters
    ----------
    module : str
        What to import; its package, which is to be installed, has the same name.
    purpose : str
        What it is needed for, such as "reading NIfTI".
    extra : str
        Of this package, which brings it with others like it.

    Raises
    ------
    ImportError
        If it is not there.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise ImportError(
            f"{purpose} needs {package}, which is not installed; "
            f"run: pip install {package} (or 'napari-unpack[{extra}]' for all like it)"
        ) from error
