"""Compiled functions, which are kept on disk where that is possible."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache as once
from typing import Any, TypeVar

import numba
from numba.core.caching import FunctionCache

Function = TypeVar("Function", bound=Callable[..., Any])


class _ForgivingCache(FunctionCache):
    """numba's files of one function; without room for them the work goes on all the same."""

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _say_unkept(error.strerror or str(error))


def njit(*, cache: bool, **options: Any) -> Callable[[Function], Function]:
    """Compile a function as `numba.njit` does, and keep what is compiled where a disk takes it.

    Parameters
    ----------
    cache : bool
        Whether it is kept.
    **options
        As for `numba.njit`.
    """
    made = numba.njit(**options)

    def compiled(function: Function) -> Function:
        dispatcher = made(function)
        if cache:
            try:
                # What numba does for `cache=True`, which lets a full disk end the work.
                dispatcher._cache = _ForgivingCache(function)
            except (OSError, RuntimeError):
                _say_unkept("no folder for it can be written to")
        return dispatcher

    return compiled


@once
def _say_unkept(reason: str) -> None:
    """Warn once of each reason: numba resets what Python knows of warnings."""
    warnings.warn(
        f"Compiled code is not kept, so the next start compiles it again: {reason}. Make room, or "
        "set NUMBA_CACHE_DIR to a folder that can be written to.",
        RuntimeWarning,
        stacklevel=1,
    )
