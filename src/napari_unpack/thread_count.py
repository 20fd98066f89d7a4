"""How many threads a process takes: one setting for the network, the kernels and all pools."""

from __future__ import annotations

import os

SETTING = "NAPARI_UNPACK_THREADS"
"""Of the environment, so that a process that is started inherits it."""


def thread_count() -> int:
    """Return how many threads work at once; by default one for each core this process may use.

    Raises
    ------
    ValueError
        If the setting is no whole number from 1 on.
    """
    # Read each time: a worker of a cluster is told after it has begun.
    text = os.environ.get(SETTING, "")
    if not text:
        # Fewer than there are where taskset or a batch system grants some; not all systems tell.
        granted = getattr(os, "sched_getaffinity", None)
        return len(granted(0)) if granted else os.cpu_count() or 1
    # Not isdigit, which takes ² as well.
    if not text.isdecimal() or int(text) < 1:
        raise ValueError(f"{SETTING} must be a whole number from 1 on, got {text!r}")
    return int(text)
