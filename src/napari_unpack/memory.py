"""Whether something fits into memory, asked before anything of it is made."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import psutil

# Version 2 of control groups, where a container has its limit.
CONTROL_GROUP = Path("/sys/fs/cgroup")
# Bytes a pixel of a picture that is drawn and written as PNG; 114 were measured.
PICTURE_BYTES = 120
# Measured: 285 to 350 in the encoder, which looks ahead over some forty frames.
ENCODER_BYTES = 350


def total_memory() -> int:
    """Return the bytes of memory that this computer has, or its container."""
    whole = int(psutil.virtual_memory().total)
    with suppress(OSError, ValueError):
        whole = min(whole, int((CONTROL_GROUP / "memory.max").read_text()))
    return whole


def free_memory() -> int:
    """Return the bytes that can be taken without anything being swapped out or ended."""
    free = int(psutil.virtual_memory().available)
    # A container has a limit of its own, which the computer's numbers do not show.
    with suppress(OSError, ValueError):
        limit, used = (
            int((CONTROL_GROUP / f"memory.{name}").read_text()) for name in ("max", "current")
        )
        free = min(free, limit - used + _cached_files())
    return free


def _cached_files() -> int:
    """Return the bytes of files a container has read: counted as used, given back when wanted."""
    with suppress(OSError, ValueError):
        lines = (CONTROL_GROUP / "memory.stat").read_text().splitlines()
        return int(dict(line.split() for line in lines)["inactive_file"])
    return 0


def check_memory(what: str, needed: float, remedy: str) -> None:
    """Raise ValueError where something needs more memory than is free.

    Parameters
    ----------
    what : str
        What was asked for, in words.
    needed : float
        Bytes.
    remedy : str
        What to do about it, in words.

    Raises
    ------
    ValueError
        If it does not fit: what it needs, what is free and what to do.
    """
    free = free_memory()
    if needed > free:
        raise ValueError(f"{what} needs {_size(needed)}, and {_size(free)} are free: {remedy}")


def check_picture(
    size: tuple[int, int], bytes_a_pixel: float = PICTURE_BYTES, what: str = "picture"
) -> None:
    """Raise ValueError where a picture, or each frame of a movie, does not fit into memory.

    Parameters
    ----------
    size : (int, int)
        Height and width, pixels.
    bytes_a_pixel : float
        Of all that is held at once.
    what : str
        What it is called.

    Raises
    ------
    ValueError
        If it does not fit.
    """
    height, width = size
    check_memory(
        f"a {what} of {width} x {height} pixels",
        float(height) * float(width) * bytes_a_pixel,
        "ask for fewer pixels",
    )


def _size(count: float) -> str:
    return f"{count / 1e9:,.1f} GB of memory"
