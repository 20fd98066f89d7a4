"""The rows of the table, one concept a file; each has `measure(scenes) -> rows`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any

from benchmarks.row import Row

ORDER = (
    "tinted_cpu",
    "tinted_gl",
    "public_functions",
    "hiding",
    "dragging",
    "turning",
    "animation",
    "answering",
    "unpackability",
    "surveying",
    "gl_occlusion",
    "interfering",
    "recolouring",
    "steady_colors",
    "unpacking_steps",
    "accuracy",
    "confidence",
    "scaling",
    "many_bags",
    "large_volume",
    "cancelling",
    "costs",
    "plugin_start",
    "stalls",
    "first_time",
    "gpu",
    "card_memory",
    "sprite_memory",
)


def chosen(names: Iterable[str]) -> list[tuple[str, Callable[[Any], list[Row]]]]:
    """Return the rows whose name contains one of some words, all where there are none.

    Raises
    ------
    ValueError
        If a word is in no row's name.
    """
    words = list(names)
    for word in words:
        if not any(word in name for name in ORDER):
            raise ValueError(f"no row is called {word!r}; there are {', '.join(ORDER)}")
    kept = [name for name in ORDER if not words or any(word in name for word in words)]
    return [(name, import_module(f"benchmarks.rows.{name}").measure) for name in kept]
