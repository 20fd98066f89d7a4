"""A volume in Zarr, larger than any memory, to labels in Zarr, block by block."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from napari_unpack.atomic import check_space, folder_written_atomically
from napari_unpack.batches.cluster import check_versions, cluster_client, losses_told
from napari_unpack.geometry.length_unit import assumed_besides_size
from napari_unpack.io.ome_zarr import is_label_image_alone, labels_zarr, stored_volume
from napari_unpack.read_errors import read_errors_told
from napari_unpack.tasks import Progress

if TYPE_CHECKING:
    import pandas as pd

    from napari_unpack.io.scan import Spacing

SHRUNK = 200
"""Bytes of labels, of four a voxel, that become one at best on the disk."""


def segment_zarr(
    source: Path,
    output: Path,
    smallest: float | None = None,
    grainy: bool | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
    working: int | None = None,
    progress: Progress | None = None,
    say: Callable[[str], None] | None = None,
    spacing: Spacing | None = None,
) -> pd.DataFrame:
    """Segment a Zarr image into an OME-Zarr label image; neither is in memory as a whole.

    Parameters
    ----------
    source : Path
        A Zarr array, or a multiscale image, of axes z, y, x.
    output : Path
        .zarr, a folder that is there whole or not at all.
    smallest, grainy
        See `segment`.
    scheduler : str, optional
        Of a Dask cluster that does the work on blocks. Without it and `workers`, threads do.
    workers : int, optional
        Processes of this machine that do.
    working : int, optional
        See `segment`.
    progress : callable, optional
        Takes (fraction, text); raising in it cancels and leaves no output.
    say : callable, optional
        Given a sentence for each thing that had to be assumed of the source, and where a cluster
        has no worker yet.
    spacing : (float, float, float) of mm, z y x, optional
        Instead of what the source says.

    Returns
    -------
    DataFrame
        See `Segmentation.objects`.

    Raises
    ------
    ImportError
        If dask.distributed is missing, where a cluster is asked for.
    ValueError
        If the source is no such image, the output is there and holds anything but labels,
        `scheduler` and `workers` are both given, or nothing is found.
    OSError
        If no scheduler answers, the cluster is lost, or the disk has too little space.
    MemoryError
        If workers end again and again, as their memory is used up.
    """
    from napari_unpack.segmentation import segment

    with read_errors_told(source, "a Zarr image"):
        array, stored = stored_volume(source)
    if spacing is not None:
        left = assumed_besides_size(stored.assumed)
        stored = replace(stored, spacing=spacing, assumed=left)
    for sentence in stored.assumed:
        if say is not None:
            say(f"note: {source.name}: {sentence}")
    check_space(output, 4 * array.size // SHRUNK)
    with ExitStack() as stack:
        client = None
        if scheduler is not None or workers is not None:
            client = stack.enter_context(cluster_client([], None, scheduler, workers))
            stack.enter_context(losses_told())
            if say is not None and not client.scheduler_info()["workers"]:
                say("the cluster has no worker yet: waiting for one")
            check_versions(client)
        place = stack.enter_context(folder_written_atomically(output, is_label_image_alone))
        labels = stack.enter_context(
            labels_zarr(place, array.shape, "int32", stored.spacing, stored.scanner_from_scan)
        )
        with _damage_told(source):
            found = segment(
                array,
                stored.spacing,
                progress=progress,
                smallest=smallest,
                grainy=grainy,
                working=working,
                out=labels,
                client=client,
            )
    return found.objects


@contextmanager
def _damage_told(source: Path) -> Iterator[None]:
    try:
        yield
    except (RuntimeError, zlib.error) as error:
        # Chunks are unpacked while objects are found, long after the image was opened; what unpacks
        # them has errors of no type of its own.
        raise ValueError(f"{source}: {error}; is one of its chunks damaged?") from error
