"""The one vispy adapter of the three layers: reads the canvas's matrices, hands quads over."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from vispy import gloo
from vispy.scene.visuals import create_visual_node

from napari_unpack.geometry.axes import Matrix, flip, flip_matrix
from napari_unpack.geometry.rays import voxel_from_world
from napari_unpack.layers.compat import PictureAdapter, PictureLayer
from napari_unpack.layers.placement import ordered
from napari_unpack.layers.slice_frame import SliceFrame
from napari_unpack.layers.view_camera import Frame, camera_from_render, camera_in_session
from napari_unpack.rendering.gl.depth_quads import Quad, QuadsVisual, clip_from_pivot
from napari_unpack.rendering.gl.matrices import matrix_of


class QuadsNode(create_visual_node(QuadsVisual)):  # type: ignore[misc]
    """Quads in a napari canvas, whose depth function is not GL's default."""

    def draw(self) -> None:
        """Draw, and leave the canvas as napari set it up."""
        super().draw()
        gloo.set_depth_func("lequal")


class QuadsAdapter(PictureAdapter):
    """Draws a layer as quads and tells the layer what the canvas showed.

    Parameters
    ----------
    layer : PictureLayer
        Its `quads_at` says what to draw, at every draw.
    **kwargs
        From napari, handed on.
    """

    def __init__(self, layer: PictureLayer, **kwargs: Any) -> None:
        super().__init__(layer, QuadsNode(), **kwargs)
        self._seen: tuple[Any, Frame | None] = None, None
        self.node.before_draw = self._before_draw
        self.node.refused = layer.refused.emit
        # In another viewer as well, the layer stays with the first: two would fight for its camera.
        if "frame_now" not in vars(layer):
            layer.frame_now = self._frame

    @property
    def _leads(self) -> bool:
        return bool(vars(self.layer).get("frame_now") == self._frame)

    def _before_draw(self, visual: QuadsVisual) -> None:
        if not self._leads:
            return
        frame = self._frame()
        quads = tuple(self._slice_quads() if frame is None else self.layer.quads_at(frame))
        # Assigning asks for another draw; this one shows them already.
        with visual.events.update.blocker():
            visual.quads = quads
            # Upon a slice pixels are those of the canvas.
            visual.clip_from_view = np.eye(4)
            if frame is not None:
                visual.clip_from_pivot = frame.clip_from_pivot
                visual.clip_from_view = self._clip_from_view()

    def _frame(self) -> Frame | None:
        view = self._view() if self.in_3d else None
        if view is None or min(view.size) < 1:
            return None
        self.stand()
        try:
            scale = float(getattr(view.canvas, "pixel_scale", 1.0))
            size = max(1, round(view.size[1] * scale)), max(1, round(view.size[0] * scale))
            corner = float(view.pos[1]) * scale, float(view.pos[0]) * scale
            transforms = self.node.transform, view.scene.transform
            whole = self.node.get_transform("scene", "render")
            matrices = [matrix_of(one) for one in (*transforms, whole)]
            key = (
                b"".join(matrix.tobytes() for matrix in matrices),
                (tuple(view.size), size, corner, tuple(view.camera.center)),
                (tuple(self.displayed), tuple(self.layer.spacing)),
            )
            # Most draws are of what moves before a camera at rest.
            if key != self._seen[0]:
                self._seen = key, self._frame_of(view, matrices, size, corner)
        # A window of no height or width projects nothing; the next draw will.
        except (ValueError, ZeroDivisionError, np.linalg.LinAlgError):
            return None
        return self._seen[1]

    def _frame_of(
        self,
        view: Any,
        matrices: Sequence[Matrix],
        size: tuple[int, int],
        corner: tuple[float, float],
    ) -> Frame:
        node, scene, whole = matrices
        # napari's transform is of the data's axes in the order displayed, to the world's in that.
        scene_from_world = node @ flip_matrix(
            ordered(self.displayed) @ voxel_from_world(self.layer.spacing)
        )
        seen = camera_from_render(_ndc_from_pixels(view.size) @ scene, flip(view.camera.center))
        camera = camera_in_session(seen, flip_matrix(scene_from_world))
        return Frame(camera, size, clip_from_pivot(whole @ scene_from_world, camera), corner)

    def _clip_from_view(self) -> Matrix:
        """Return the map from the clip space of the view to the canvas's, which a grid divides."""
        view = self._view()
        if view is None:
            return np.eye(4)
        whole = matrix_of(view.get_transform("visual", "render"))
        found: Matrix = whole @ np.linalg.inv(_ndc_from_pixels(view.size))
        return found

    def _slice_quads(self) -> Sequence[Quad]:
        if len(self.displayed) != 2:
            return ()
        self.stand()
        width, height = self.node.canvas.physical_size
        whole = matrix_of(self.node.get_transform("scene", "render"))
        # From x, y, z, w of the layer's data to x and y of the canvas, -1 to 1.
        ndc = (whole @ matrix_of(self.node.transform))[:2][:, [1, 0, 3]]
        half = np.array([width, height]) / 2
        pixels = (ndc * np.array([[1.0], [-1.0]])) * half[:, None]
        pixels[:, 2] += half - 0.5
        down, right = self.displayed
        frame = SliceFrame((height, width), (down, right), pixels[::-1])
        return self.layer.slice_quads_at(frame)

    def _view(self) -> Any | None:
        """Return the view box that shows the layer."""
        node = self.node.parent
        # In a grid every layer has a view box of its own.
        while node is not None and not hasattr(node, "camera"):
            node = node.parent
        return None if node is None or not hasattr(node.camera, "fov") else node

    def close(self) -> None:
        """Disconnect from the layer and let go of the node."""
        # Both would keep the layer alive with the node.
        self.node.before_draw = self.node.refused = None
        if self._leads:
            del self.layer.frame_now
        super().close()


def _ndc_from_pixels(size: tuple[float, float]) -> Matrix:
    """Return the map from a view box's pixels (x, y down) to its own clip space."""
    matrix = np.diag([2 / size[0], -2 / size[1], 1.0, 1.0])
    matrix[0, 3], matrix[1, 3] = -1.0, 1.0
    return matrix
