"""Says that kernels are being compiled, which takes most of the time on the first day."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from typing import Any

from numba.core import event

from napari_unpack.tasks import Cancelled, Progress

PREPARING = "Preparing: compiled once on this machine"


class _Listener(event.Listener):  # type: ignore[misc]
    def __init__(self, progress: Progress) -> None:
        self.share, self._progress = 0.0, progress

    def on_start(self, _event: Any) -> None:
        if _LISTENING.get() is not self:
            return
        # Not out of the middle of numba: the next report of the work itself stops it.
        with suppress(Cancelled):
            self._progress(self.share, PREPARING)

    def on_end(self, _event: Any) -> None:
        pass


# By context, which work takes along to a thread of its own.
_LISTENING: ContextVar[_Listener | None] = ContextVar("listening", default=None)


@contextmanager
def compiling_told(progress: Progress) -> Iterator[Progress]:
    """Give a progress that also says when this work compiles a kernel.

    Parameters
    ----------
    progress : callable
        Takes (fraction, text).
    """
    listener = _Listener(progress)

    def told(fraction: float, text: str) -> None:
        listener.share = fraction
        progress(fraction, text)

    # Loading what was compiled before is no such event.
    token = _LISTENING.set(listener)
    try:
        with event.install_listener("numba:compile", listener):
            yield told
    finally:
        _LISTENING.reset(token)
