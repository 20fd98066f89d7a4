"""Compiled kernels of numba, kept by one process at a time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

LOCK = "napari-unpack.lock"


def keep_kernels_one_at_a_time() -> None:
    """Have this process wait for its turn before it adds a kernel to numba's cache.

    numba reads the index of a function's kernels, adds to it and writes it back. Two processes
    doing so at once could file one kernel under the other's types, and workers that begin together
    compile the same kernels together.
    """
    try:
        from fcntl import LOCK_EX, flock
    except ImportError:
        # On Windows a file that is open cannot be replaced: numba gives up writing there.
        return
    from numba.core.caching import IndexDataCacheFile

    save = IndexDataCacheFile.save
    if getattr(save, "alone", False):
        return

    def save_alone(file: Any, key: Any, data: Any) -> None:
        # Beside the kernels: machines that share these share the lock.
        with Path(file._index_path).with_name(LOCK).open("w") as lock:
            flock(lock, LOCK_EX)
            save(file, key, data)

    save_alone.alone = True  # type: ignore[attr-defined]
    IndexDataCacheFile.save = save_alone  # type: ignore[method-assign]
