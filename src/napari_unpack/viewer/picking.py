"""What a pixel shows, packed objects, sprites and depths, and how an object is seen."""

from __future__ import annotations

from typing import TYPE_CHECKING

from napari_unpack.geometry.transforms import Projection
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.casting import TABLE_ENTRIES, rays_for
from napari_unpack.rendering.cpu import by_contribution, contributions
from napari_unpack.rendering.scene import Scene
from napari_unpack.rendering.subvolumes import Subvolume
from napari_unpack.session.object_state import ObjectState

if TYPE_CHECKING:
    from napari_unpack.viewer.scene_renderer import SceneRenderer

# Contribution to a pixel below which an object cannot be seen there.
LEAST_ALPHA = 0.02


def pick_packed(
    scene: Scene, subvolume: Subvolume, frame: Frame, row: float, col: float
) -> list[int]:
    """List the packed objects on a pixel's ray.

    Parameters
    ----------
    scene : Scene
        With what is packed.
    subvolume : Subvolume
        The whole volume.
    frame : Frame
        What the canvas shows.
    row, col : float
        Pixel of the frame.

    Returns
    -------
    list of int
        The object that contributes most, then those behind it, then those before it; empty
        where nothing is seen. Matter without a label is left out.

    Notes
    -----
    docs/paper.md, R13. One ray: well under a millisecond.
    """
    window = round(row), round(col), 1, 1
    rays = rays_for(
        frame.camera,
        frame.size,
        scene.spacing,
        voxel_from_world=subvolume.voxel_from_world,
        window=window,
    )
    function = scene.transfer_function
    shares = contributions(
        subvolume.volume,
        subvolume.labels,
        rays,
        scene.spacing,
        function.table(TABLE_ENTRIES),
        function.domain,
        scene.packed_tints,
        scene.clipping,
    )
    return [label for label, share in by_contribution(shares) if label > 0 and share > LEAST_ALPHA]


class ScenePicker:
    """Says what pixels of the frame show.

    Parameters
    ----------
    renderer : SceneRenderer
    """

    def __init__(self, renderer: SceneRenderer) -> None:
        self._renderer = renderer

    def sprite_at(self, row: float, col: float) -> int:
        """Return the object whose sprite is at a pixel, 0 for none.

        Parameters
        ----------
        row, col : float
            Of the frame.
        """
        frame, sprites = self._renderer.frame, self._renderer.sprites
        if frame is None or not sprites.visible or not frame.holds(row, col):
            return 0
        return sprites.at_pixel(row, col, frame.size, frame.camera)

    def packed_at(self, row: float, col: float) -> list[int]:
        """Return the packed objects at a pixel, the most visible first.

        Parameters
        ----------
        row, col : float
            Of the frame.
        """
        frame = self._renderer.frame
        if frame is None or not self._renderer.packed.visible or not frame.holds(row, col):
            return []
        found = pick_packed(
            self._renderer.session.scene(),
            self._renderer.packed_renderer.known_subvolume(),
            frame,
            row,
            col,
        )
        return [i for i in found if i in self._renderer.session.states]

    def projection_of(self, object_id: int, frame: Frame) -> Projection | None:
        """Return how an object is seen where it stands now; None where it is not seen at all.

        Parameters
        ----------
        object_id : int
            0 for what belongs to no object.
        frame : Frame
            What the canvas shows.
        """
        renderer, session = self._renderer, self._renderer.session
        in_bag = Projection(frame.camera.pivot_from_world(), frame.camera)
        if object_id not in session.states:
            return in_bag
        if session.states[object_id] is ObjectState.HIDDEN:
            return None
        center = session.boxes.center(object_id, session.spacing)
        moving = renderer.animator.moving(renderer.flight_animation.now(), frame).get(object_id)
        if moving is not None:
            return moving.pose.projection(center, frame.camera, moving.flatness)
        waiting = session.poses.get(object_id)
        if waiting is None:
            return in_bag
        # A sprite that glides, or is carried, is not yet where the session knows it.
        sprite = renderer.sprites.sprites.get(object_id)
        pose = waiting if sprite is None else sprite.pose
        return pose.projection(center, frame.camera, 1.0)
