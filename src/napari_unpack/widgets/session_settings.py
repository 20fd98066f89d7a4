"""What the panel's controls set: how objects leave, what draws them, how they look."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from napari_unpack.widgets.notifications import errors_shown, warn
from napari_unpack.widgets.preferences import remember_names
from napari_unpack.widgets.workspace import Workspace

if TYPE_CHECKING:
    from napari_unpack.appearance import Decorations, TransferFunction
    from napari_unpack.appearance.tints import Mode
    from napari_unpack.session import Session
    from napari_unpack.widgets.directions import Direction

# Field of view of the gentle perspective, degrees: wide enough that an object which flies towards
# the viewer is seen to come nearer, narrow enough that sprites at the edge look upright.
GENTLE_FOV = 20.0


class SessionSettings:
    """Setters for the session that the workspace shows; without a session they do nothing."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._said_unkept = False

    # How objects leave.

    def set_direction(self, direction: Direction) -> None:
        """Set the direction in which objects leave."""
        if (session := self._workspace.session) is not None:
            with errors_shown():
                session.direction = direction

    def set_drawing(self, drawing: bool) -> None:
        """Show the 3D view and have the next drag in it draw the direction, or not."""
        if (controller := self._workspace.controller) is not None:
            pencil = controller.interaction.pencil
            if drawing:
                self._workspace.viewer.dims.ndisplay = 3
                pencil.begin()
            elif pencil.drawing:
                pencil.stop()

    def turn_arrow(self, way: tuple[float, float]) -> None:
        """Turn the arrow that is being drawn by a step towards a side: rows down, columns right."""
        if (controller := self._workspace.controller) is not None:
            controller.interaction.pencil.turn(way)

    def take_arrow(self, along_normal: bool = False) -> None:
        """Have objects leave along the arrow, or straight out of the surface at its start."""
        if (controller := self._workspace.controller) is not None:
            with errors_shown():
                controller.interaction.pencil.take_turned(along_normal)

    def set_take_least_occluded(self, taken: bool) -> None:
        """Unpack the least occluded object where none is unpackable, or refuse."""
        if (session := self._workspace.session) is not None:
            session.take_least_occluded = taken

    def set_seconds(self, seconds: float) -> None:
        """Set the duration of a flight, s."""
        if (controller := self._workspace.controller) is not None:
            controller.seconds = seconds

    # What draws them.

    def set_backend(self, backend: str) -> None:
        """Choose what draws: "auto", "gl" or "cpu"."""
        if (controller := self._workspace.controller) is not None:
            with errors_shown():
                controller.backend = backend

    def set_perspective(self, gentle: bool) -> None:
        """Look with a gentle perspective, or in parallel."""
        if (controller := self._workspace.controller) is not None:
            self._workspace.viewer.scene.camera.perspective = GENTLE_FOV if gentle else 0.0
            controller.framing.fit(glides=False)

    def set_outlines(self, shown: bool) -> None:
        """Outline unpackable objects in the 3D view, or not."""
        if (controller := self._workspace.controller) is not None:
            controller.overlays.outlines_unpackable = shown

    def set_names(self, shown: bool) -> None:
        """Write the names of unpacked objects beside them, or not; remembered where possible."""
        if (controller := self._workspace.controller) is not None:
            controller.names.shown = shown
        try:
            remember_names(shown)
        except OSError as error:
            # Once: what was asked for is done.
            if not self._said_unkept:
                self._said_unkept = True
                warn(f"Not remembered for the next start: {error.strerror or error}.")

    # How they look.

    def set_tint_mode(self, mode: Mode) -> None:
        """Choose how hues become colours: "perceptual", "safe" or "hsv"."""
        if (session := self._workspace.session) is not None:
            with errors_shown():
                session.tint_mode = mode

    def set_transfer_function(self, make: Callable[[Session], TransferFunction]) -> None:
        """Set the opacity and colours of densities.

        Parameters
        ----------
        make : callable
            Takes the session; may raise ValueError, which is shown.
        """
        if (session := self._workspace.session) is not None:
            with errors_shown():
                session.transfer_function = make(session)

    def set_show_unlabelled(self, shown: bool) -> None:
        """Draw the matter that belongs to no object, or leave it out."""
        if (session := self._workspace.session) is not None:
            session.show_unlabelled = shown

    def set_recolor_at_rest(self, on: bool) -> None:
        """Recolour whenever the camera comes to rest, or not."""
        if (controller := self._workspace.controller) is not None:
            controller.recolor_at_rest = on

    def set_decorations(self, make: Callable[[], Decorations]) -> None:
        """Set the background, the box and the scale bar.

        Parameters
        ----------
        make : callable
            Returns them; may raise ValueError or OSError, which is shown.
        """
        if (session := self._workspace.session) is not None:
            with errors_shown():
                session.decorations = make()
