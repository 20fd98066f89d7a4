"""The viewer's camera and the session's: each made to look as the other does."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from napari_unpack.geometry.view import GRAVITY_UP, Camera
from napari_unpack.layers.compat import PictureLayer
from napari_unpack.layers.placement import napari_from_world, scene_from_world, units_of
from napari_unpack.layers.view_camera import ALIKE, napari_view, parts_of

if TYPE_CHECKING:
    import napari

    from napari_unpack.session import Session


def point_camera(
    viewer: napari.Viewer, layer: PictureLayer, camera: Camera, turns: bool = True
) -> None:
    """Have a viewer look as a camera does.

    Parameters
    ----------
    viewer : napari.Viewer
    layer : PictureLayer
        One of ours, which knows how world mm lie in napari's world.
    camera : Camera
        Of the session.
    turns : bool, optional
        False leaves its direction to the hand that may be turning the bag.
    """
    height = viewer.canvas.size[0]
    scene = scene_from_world(layer, units_of(viewer))
    center, zoom, direction, up = napari_view(camera, scene, height)
    theirs = viewer.scene.camera
    theirs.perspective = camera.fov
    theirs.center = tuple(center)
    if turns:
        theirs.set_view_direction(tuple(direction), tuple(up))
    theirs.zoom = zoom


def follow_placement(viewer: napari.Viewer, session: Session, layer: PictureLayer) -> None:
    """Have a session look at its bag as a layer places it, and know what is up there.

    Parameters
    ----------
    viewer : napari.Viewer
    session : Session
        It keeps its direction of looking.
    layer : PictureLayer
        One of ours.
    """
    world = napari_from_world(layer, units_of(viewer))
    # Level things have normals, which an affine maps the other way than points.
    session.away_from_table = world[:3, :3].T @ GRAVITY_UP
    stretch = parts_of(scene_from_world(layer, units_of(viewer)))[2]
    seen = session.camera
    if not np.allclose(stretch, seen.stretch, rtol=0, atol=ALIKE):
        session.look(
            Camera.looking(seen.direction, seen.up, seen.center, seen.height, seen.fov, stretch)
        )
