"""What was removed from a viewer's layer list in one go, to be put back."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from napari_unpack.layers import compat
from napari_unpack.viewer.scheduler import Scheduler
from napari_unpack.viewer.viewer_state import SavedView

if TYPE_CHECKING:
    import napari
    from napari.layers import Layer

    from napari_unpack.viewer.controller import SessionController


class RemovedLayers:
    """Remembers the layers that one command removes, until the event loop has the turn again.

    Parameters
    ----------
    viewer : napari.Viewer
        Or the public proxy of it.
    scheduler : Scheduler

    Notes
    -----
    napari lets nobody call a removal off; what is put back is as if it had been.
    """

    def __init__(self, viewer: napari.Viewer, scheduler: Scheduler) -> None:
        self._viewer: napari.Viewer = compat.unwrap(viewer)
        self._scheduler = scheduler
        self._removed: list[tuple[int, Layer]] = []
        self._view: SavedView | None = None
        self._ndisplay = 3
        self._viewer.layers.events.removed.connect(self._on_removed)

    def close(self) -> None:
        """Remember nothing more."""
        self._viewer.layers.events.removed.disconnect(self._on_removed)
        self._removed.clear()

    def put_back(self, settle: Callable[[], None]) -> list[Layer]:
        """Put all of them back at their places, and return them.

        Parameters
        ----------
        settle : callable
            Has the camera be where it goes: napari fits the view to the layers that are left.
        """
        removed, view = self._removed[::-1], self._view
        self._removed.clear()
        layers, viewer = self._viewer.layers, self._viewer
        # And anew when the first layer comes.
        with viewer.events.reset_view.blocker():
            for index, layer in removed:
                if layer not in layers:
                    layers.insert(min(index, len(layers)), layer)
        if removed and view is not None:
            settle()
            viewer.dims.ndisplay = self._ndisplay
            view.give_back(viewer.scene.camera)
            # What is deleted is what was selected.
            layers.selection = {layer for _, layer in removed}
        return [layer for _, layer in removed]

    def _on_removed(self, event: Any) -> None:
        if not self._removed:
            self._view = SavedView.of(self._viewer.scene.camera)
            self._ndisplay = int(self._viewer.dims.ndisplay)
            # Posted now, so after what others post while they hear of the removal.
            self._scheduler.soon(lambda: self._scheduler.soon(self._removed.clear))
        self._removed.append((event.index, event.value))


def close_without_layer(controller: SessionController) -> None:
    """Close, as one of its layers was removed; soon, where others of them are selected.

    napari removes what is selected one by one, and stumbles over what is gone already.
    """
    layers = controller.viewer.layers
    if any(layer in layers.selection for layer in controller.layers if layer in layers):
        controller.scheduler.soon(controller.close)
    else:
        controller.close()
