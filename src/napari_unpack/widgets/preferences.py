"""The plugin's page in napari's preferences, as plain values.

Keys and values of the page are stored on the user's disk, so they keep the words they had at
first, also where the panel says it otherwise today.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

# As stored under `when_nobody_is_free`.
TAKE_LEAST_OCCLUDED = "Take the least blocked"

BACKENDS = {"Best available": "auto", "Graphics card": "gl", "Processor": "cpu"}


@dataclass(frozen=True)
class Preferences:
    """The user's preferences; the defaults are those of the manifest.

    Parameters
    ----------
    seconds : float
        Duration of one flight.
    take_least_occluded : bool
        Unpack the least occluded object where none is unpackable.
    backend : str
        "auto", "gl" or "cpu".
    recolor_at_rest : bool
        Recolour whenever the camera comes to rest.
    names : bool
        Write the names of unpacked objects beside them.
    keep_unsaved : bool
        Keep unsaved work on disk in case napari ends unexpectedly.
    """

    seconds: float = 1.2
    take_least_occluded: bool = True
    backend: str = "auto"
    recolor_at_rest: bool = True
    names: bool = False
    keep_unsaved: bool = True


def preferences() -> Preferences:
    """Read the user's preferences from napari.

    Returns
    -------
    Preferences
        The defaults where napari does not know the plugin, as when its manifest is blocked.
    """
    from napari.settings import get_plugin_settings

    try:
        stored = get_plugin_settings("napari-unpack")
    except KeyError:
        return Preferences()
    return Preferences(
        seconds=float(stored.unpacking.seconds),
        take_least_occluded=stored.unpacking.when_nobody_is_free == TAKE_LEAST_OCCLUDED,
        backend=BACKENDS.get(stored.drawing.backend, "auto"),
        recolor_at_rest=bool(stored.drawing.recolor_at_rest),
        # Preferences stored by earlier versions say nothing of it.
        names=bool(getattr(stored.drawing, "names", False)),
        keep_unsaved=bool(getattr(getattr(stored, "files", None), "keep_unsaved", True)),
    )


def remember_names(shown: bool) -> None:
    """Store whether names are written beside sprites; nothing where napari keeps no settings."""
    from napari.settings import get_plugin_settings

    with suppress(KeyError, AttributeError):
        get_plugin_settings("napari-unpack").drawing.names = shown
