"""From a volume to a session: the long work behind step 1, run off the main thread."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from napari_unpack.tasks import Progress
from napari_unpack.widgets.layer_inputs import Volume, in_memory

TOLERANCE = 0.003
"""Share of an object that may be blocked and it still counts as free: labels of real scans are
ragged by a voxel here and there (0.3 % at most in the bags of the paper's figure 7)."""

GENTLE = 20.0
"""Field of view in degrees at first: enough that what flies towards the viewer is seen to."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """A session, and the labels if they were found rather than given.

    Parameters
    ----------
    session : napari_unpack.Session
    found : (Z, Y, X) ndarray of int32 or None
        New labels to show as a layer; None when the user's own were used.
    """

    session: Any
    found: Any


def prepare(
    volume: Volume,
    labels: Any,
    names: Mapping[int, str],
    settings: dict[str, Any],
    progress: Progress,
) -> Prepared:
    """Segment a volume unless labels are given, and make its session.

    Parameters
    ----------
    volume : Volume
    labels : (Z, Y, X) array of int or None
        Object IDs to use; None segments.
    names : mapping of int to str
        What objects of these labels are called, by ID; may be empty.
    settings : dict
        Keyword arguments of `napari_unpack.segment`.
    progress : callable
        Takes (fraction in [0, 1], text); raises to cancel.

    Returns
    -------
    Prepared

    Raises
    ------
    ValueError
        If the volume or the labels cannot be used, or nothing was found.
    """
    from napari_unpack.io.headless import named_objects

    progress(0.0, "Reading the volume")
    # Loaded here, the modules of the stage do not hold up the window later.
    importlib.import_module("napari_unpack.viewer.controller")
    density = in_memory(volume)
    objects = named_objects(names)
    found = None
    if labels is None:
        from napari_unpack.segmentation import segment

        with _in_words_of_the_panel():
            segmentation = segment(
                density,
                spacing=volume.spacing,
                progress=lambda fraction, text: progress(0.9 * fraction, text),
                **settings,
            )
        labels = found = segmentation.labels
        objects = segmentation.objects
    progress(0.9, "Measuring the objects")
    ids = np.asarray(labels)
    if not ids.any():
        raise ValueError(
            f"no objects were found in '{volume.name}': it may hold nothing denser than its "
            "surroundings, or the labels are empty"
        )
    from napari_unpack.geometry.view import FROM_ABOVE, View
    from napari_unpack.session import Session

    session = Session(density, ids, spacing=volume.spacing, objects=objects)
    session.view = View(direction=FROM_ABOVE, fov=GENTLE)
    session.tolerance = TOLERANCE
    progress(1.0, "Opening the stage")
    return Prepared(session, found)


@contextmanager
def _in_words_of_the_panel() -> Iterator[None]:
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
