"""How much memory the work on a scan takes, from the header of its file."""

from __future__ import annotations

from napari_unpack.batches.inputs import ScanInput
from napari_unpack.file_sizes import asked_size
from napari_unpack.io.volumes import load_volume
from napari_unpack.memory import free_memory

BASE = 700_000_000
"""Bytes of a process that has segmented nothing yet, with its libraries and a tile of the network;
650 MB were measured on a million voxels."""

A_BYTE = 40
"""Bytes for each byte of a volume (two a voxel) that is segmented whole; 30 were measured."""

WHOLE = 32_000_000
"""Bytes of a volume from which it is segmented on a reduced grid, see `WORKING_VOXELS`."""

A_LARGE_BYTE = 12
"""For each byte beyond, with its labels and what is drawn; 11 were measured at 268 Mvoxel."""


def need_of(scan: ScanInput) -> int:
    """Return the bytes of memory that the work on a scan takes, before it is read.

    Raises
    ------
    ValueError, OSError, ImportError
        As for `load_volume`, where its header cannot be read.
    """
    size = asked_size(lambda: load_volume(scan.volume, large=True)) or 0
    return BASE + A_BYTE * min(size, WHOLE) + A_LARGE_BYTE * max(size - WHOLE, 0)


def check_need(scan: ScanInput, memory: int | None) -> None:
    """Refuse a scan that is too big for a worker, before it is read.

    Parameters
    ----------
    scan : ScanInput
    memory : int, optional
        Bytes that it may take; what is free without it.

    Raises
    ------
    ValueError
        If it takes more; else as for `need_of`.
    """
    need, most = need_of(scan), free_memory() if memory is None else memory
    if need > most:
        raise ValueError(
            f"{scan.volume} takes about {need / 1e9:.1f} GB, and a worker has {most / 1e9:.1f} GB: "
            "give workers more memory (fewer of them), or --large to try all the same"
        )
