"""From a volume to a session: the long work behind step 1, run off the main thread."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.masks import unmasked
from napari_unpack.tasks import Progress, Share, attended
from napari_unpack.viewer.warm_up import color_labels
from napari_unpack.widgets.layer_inputs import LazyArray, Volume, in_memory
from napari_unpack.widgets.session_settings import GENTLE_FOV

if TYPE_CHECKING:
    import pandas as pd

    from napari_unpack.segmentation import Segmentation
    from napari_unpack.session import Session

# Share of an object that may be blocked and it still counts as unpackable. Labels of real scans are
# ragged by a voxel here and there; in the paper's figure 7 up to 0.3 % of an object that leaves are
# still occluded.
TOLERANCE = 0.003

# Of the progress bar: finding objects takes that much of the time in bags of any size.
SEGMENTING_SHARE = 0.9


@dataclass(frozen=True, eq=False)
class BuiltSession:
    """A session, and its labels.

    Parameters
    ----------
    session : napari_unpack.Session
    labels : (Z, Y, X) ndarray of int
        With the IDs that they were found or given with; never the array of the session's.
    is_found : bool
        Whether they are new, and not the user's own.
    """

    session: Session
    labels: NDArray[np.integer[Any]]
    is_found: bool


def build(
    volume: Volume,
    labels: ArrayLike | None,
    names: Mapping[int, str],
    settings: dict[str, Any],
    progress: Progress,
    whole_labels: LazyArray | None = None,
) -> BuiltSession:
    """Segment a volume unless labels are given, and make its session.

    Parameters
    ----------
    volume : Volume
    labels : (Z, Y, X) array of int or None
        Object IDs; None segments the volume.
    names : mapping of int to str
        Of objects of these labels, by ID; may be empty.
    settings : dict
        Keyword arguments of `napari_unpack.segment`.
    progress : callable
        Takes (fraction in [0, 1], text); raises to cancel.
    whole_labels : (Z, Y, X) array of int, optional
        These labels at full resolution, where the volume is a level of a larger one: what is
        measured of objects is measured there.

    Raises
    ------
    ValueError
        If the volume or the labels cannot be used, or nothing was found.
    """
    from napari_unpack.io.headless import named_objects

    # Here, in the worker: it loads numba.
    from napari_unpack.viewer.compiling import compiling_told

    with compiling_told(progress) as told:
        told(0.0, "Reading the volume")
        # The import takes seconds: here, in the worker, it does not freeze the window later.
        importlib.import_module("napari_unpack.viewer.controller")
        density = in_memory(volume)
        objects = named_objects(names)
        found: NDArray[np.int32] | None = None
        evidence, share = None, Share(told)
        finding = share.part(0.0, SEGMENTING_SHARE)
        if labels is None:
            from napari_unpack.segmentation import segment

            with _advice_about_the_panel():
                if volume.whole is None:
                    segmentation = segment(
                        density, spacing=volume.spacing, progress=finding, **settings
                    )
                    found = segmentation.labels
                else:
                    found, segmentation = _segmented_whole(volume, settings, finding)
            labels, objects, evidence = found, segmentation.objects, segmentation.evidence
        measuring = share.part(SEGMENTING_SHARE, 1.0, "Measuring the objects")
        given = unmasked(labels, 0)
        # A brush may write into a layer's own array while its objects are measured.
        ids = given.copy() if found is None and isinstance(labels, np.ndarray) else given
        if not ids.any():
            raise ValueError(
                f"no objects were found in '{volume.name}': it may hold nothing denser than its "
                "surroundings, or the labels are empty"
            )
        if whole_labels is not None and volume.whole is not None:
            objects = _measured_whole(volume, whole_labels, ids, objects, measuring.part(0.0, 0.9))
            measuring = measuring.part(0.9, 1.0)
        from napari_unpack.geometry.view import FROM_ABOVE, View
        from napari_unpack.session import Session
        from napari_unpack.session.framing import fitted

        made = partial(Session, density, ids, spacing=volume.spacing, objects=objects)
        session = attended(made, measuring)
        session.review.evidence = evidence
        session.view = View(direction=FROM_ABOVE, fov=GENTLE_FOV)
        session.tolerance = TOLERANCE
        color_labels(ids.dtype, len(session.ids))
        # Here, in the worker: the layer's labels are not to be ours, and the bag's hull is found.
        session.own_labels([given])
        fitted(session)
        told(1.0, "Opening the 3D view")
        return BuiltSession(session, given, found is not None)


def _segmented_whole(
    volume: Volume, settings: dict[str, Any], share: Share
) -> tuple[NDArray[np.int32], Segmentation]:
    """Find the objects at full resolution, block by block; return their labels at the level too.

    The labels of the whole lie on the disk meanwhile.
    """
    from napari_unpack.io.ome_zarr import new_label_array
    from napari_unpack.segmentation import segment

    whole, spacing = volume.whole, volume.whole_spacing
    assert whole is not None, "asked before"
    with TemporaryDirectory(prefix="napari-unpack-") as folder:
        stored = new_label_array(Path(folder) / "labels.zarr", whole.shape, np.int32)
        found = segment(whole, spacing, progress=share, out=stored, **settings)
        # The middle one of the voxels that one of the level stands for.
        every = tuple(slice(f // 2, None, f) for f in volume.factors)
        labels = np.zeros(volume.data.shape, np.int32)
        taken = stored[every][tuple(slice(0, n) for n in labels.shape)]
        labels[tuple(slice(0, n) for n in taken.shape)] = taken
    return labels, replace(found, labels=labels)


def _measured_whole(
    volume: Volume,
    labels: LazyArray,
    ids: NDArray[np.integer[Any]],
    named: pd.DataFrame | None,
    share: Share,
) -> pd.DataFrame:
    """Return the table of the objects at a level, measured at full resolution."""
    from napari_unpack.segmentation.common.array_source import source_of
    from napari_unpack.segmentation.large_volumes import measured_objects

    present = np.unique(ids[ids != 0])
    source = source_of(volume.whole)
    table = measured_objects(source, labels, present, volume.whole_spacing, share)
    if volume.labelled:
        # Labels that stand for their volume have no densities.
        table = table.drop(columns="mean_density")
    return table if named is None else table.join(named)


@contextmanager
def _advice_about_the_panel() -> Iterator[None]:
    """Replace advice about keyword arguments by advice about the panel."""
    try:
        yield
    except ValueError as error:
        reason, _, advice = str(error).partition("; pass ")
        if "foreground=" not in advice:
            raise
        raise ValueError(
            f"{reason}; under Details in step 1 you can choose a lower fixed density "
            "and a smaller size"
        ) from error
