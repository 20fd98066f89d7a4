"""The state of an unpacking and the verbs that change it."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from napari_unpack.session.asking import Casters, OcclusionAnswer, OcclusionQuestion
    from napari_unpack.session.errors import BlockedError, NobodyFreeError
    from napari_unpack.session.log import LogEntry
    from napari_unpack.session.session import Session
    from napari_unpack.session.state import ObjectState

_HOMES = {
    "BlockedError": "errors",
    "Casters": "asking",
    "LogEntry": "log",
    "NobodyFreeError": "errors",
    "ObjectState": "state",
    "OcclusionAnswer": "asking",
    "OcclusionQuestion": "asking",
    "Session": "session",
}

__all__ = [
    "BlockedError",
    "Casters",
    "LogEntry",
    "NobodyFreeError",
    "ObjectState",
    "OcclusionAnswer",
    "OcclusionQuestion",
    "Session",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
