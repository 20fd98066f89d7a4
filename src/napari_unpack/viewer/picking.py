"""Which packed object a pixel shows: the one that contributes most to it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.geometry.axes import Matrix, Vector, transform_points
from napari_unpack.geometry.transforms import Pose, packed_pose
from napari_unpack.layers.rendered_image import RenderedImage
from napari_unpack.layers.view_camera import Frame
from napari_unpack.rendering.casting import TABLE_ENTRIES, rays_for
from napari_unpack.rendering.cpu import by_contribution, contributions
from napari_unpack.rendering.scene import Scene
from napari_unpack.rendering.subvolumes import Subvolume
from napari_unpack.viewer.direction_arrow import pivot_points

if TYPE_CHECKING:
    from napari_unpack.viewer.scene_renderer import SceneRenderer

Voxel = tuple[int, int, int]

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


def first_voxel(
    scene: Scene, object_id: int, pose: Pose, frame: Frame, pixel: tuple[float, float]
) -> Voxel | None:
    """Return the voxel of an object that is seen on a pixel, the nearest to the viewer.

    Parameters
    ----------
    scene : Scene
        With its labels.
    object_id : int
    pose : Pose
        Where the object stands.
    frame : Frame
        What the canvas shows.
    pixel : (float, float)
        Row and column of the frame.

    Returns
    -------
    tuple of int or None
        z, y, x; None where the pixel's ray does not meet the object.
    """
    camera, spacing = frame.camera, scene.spacing
    pivot_from_world = pose.pivot_from_world(scene.boxes.center(object_id, spacing))
    world_from_pivot: Matrix = np.linalg.inv(pivot_from_world).astype(np.float64)
    point = pivot_points(np.array([pixel], dtype=np.float64), camera, frame.size)[0]
    # By mm towards the viewer: all rays of a perspective meet in the eye.
    towards = np.array([1.0, *(-point[1:] / camera.distance)])
    start = transform_points(world_from_pivot, point) / spacing
    step = world_from_pivot[:3, :3] @ towards / spacing
    box = scene.boxes.slices(object_id)
    ends = np.array([[s.start, s.stop] for s in box], dtype=np.int64)
    spots = _voxels_along(start, step, ends)
    for origin, normal in scene.clipping if object_id in scene.packed else ():
        spots = spots[(spots - origin) @ normal >= 0]
    # The picture shows a fringe around objects as theirs: where there is nothing else, it counts.
    for labels in (scene.label_data.labels, scene.labels):
        hits = np.flatnonzero(labels[tuple(spots.T)] == object_id)
        if len(hits):
            z, y, x = (int(v) for v in spots[hits[0]])
            return z, y, x
    return None


def _voxels_along(start: Vector, step: Vector, ends: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the (N, 3) voxels of a half-open box along start + t step, from the largest t on."""
    bounds = ends - 0.5
    moving = step != 0
    within = (start >= bounds[:, 0]) & (start < bounds[:, 1])
    crossings = (bounds[moving] - start[moving, None]) / step[moving, None]
    low, high = crossings.min(axis=1).max(), crossings.max(axis=1).min()
    if low >= high or not within[~moving].all():
        return np.zeros((0, 3), np.int64)
    # Half a voxel at a time, so that none is passed over.
    t = np.arange(high, low, -0.5 / float(np.abs(step).max()))
    spots = np.rint(start + t[:, None] * step).astype(np.int64)
    return np.clip(spots, ends[:, 0], ends[:, 1] - 1)


class ScenePicker:
    """Says what pixels of the frame show.

    Parameters
    ----------
    renderer : SceneRenderer
    """

    def __init__(self, renderer: SceneRenderer) -> None:
        self._renderer = renderer

    def depth(self) -> NDArray[np.float32]:
        """Return the depths of the packed image, (H, W) t in mm; +inf where none is known."""
        shape = (1, 1) if self._renderer.frame is None else self._renderer.frame.size
        depth = np.full(shape, np.inf, np.float32)
        # What the graphics card cast has its depths there, and is not read back.
        image = self._renderer.packed.image
        if isinstance(image, RenderedImage) and image.size == shape:
            patch = image.patch
            low = max(patch.row, 0), max(patch.col, 0)
            part = patch.depth[low[0] - patch.row :, low[1] - patch.col :]
            view = depth[low[0] :, low[1] :][: part.shape[0], : part.shape[1]]
            view[:] = part[: view.shape[0], : view.shape[1]]
        return depth

    def sprite_at(self, row: float, col: float) -> int:
        """Return the object whose sprite is at a pixel, 0 for none.

        Parameters
        ----------
        row, col : float
            Of the frame.
        """
        if self._renderer.frame is None or not self._renderer.sprites.visible:
            return 0
        return self._renderer.sprites.at_pixel(
            row, col, self._renderer.frame.size, self._renderer.frame.camera
        )

    def packed_at(self, row: float, col: float) -> list[int]:
        """Return the packed objects at a pixel, the most visible first.

        Parameters
        ----------
        row, col : float
            Of the frame.
        """
        frame = self._renderer.frame
        if frame is None or not self._renderer.packed.visible:
            return []
        if not (0 <= round(row) < frame.size[0] and 0 <= round(col) < frame.size[1]):
            return []
        found = pick_packed(
            self._renderer.session.scene(),
            self._renderer.packed_renderer.known_subvolume(),
            frame,
            row,
            col,
        )
        return [i for i in found if i in self._renderer.session.states]

    def pose_of(self, object_id: int, frame: Frame) -> Pose:
        """Return where an object stands now, in the bag or outside.

        Parameters
        ----------
        object_id : int
        frame : Frame
            What the canvas shows.
        """
        renderer, session = self._renderer, self._renderer.session
        moving = renderer.animator.moving(renderer.flight_animation.now(), frame)
        if object_id in moving:
            return moving[object_id].pose
        center = session.boxes.center(object_id, session.spacing)
        return session.poses.get(object_id) or packed_pose(center, frame.camera)

    def voxel_on(self, object_id: int, row: float, col: float) -> Voxel | None:
        """Return the voxel of an object that a pixel shows, z y x; None where it shows none.

        Parameters
        ----------
        object_id : int
            In the bag, outside or inspected.
        row, col : float
            Of the frame.
        """
        frame = self._renderer.frame
        if frame is None:
            return None
        pose = self.pose_of(object_id, frame)
        return first_voxel(self._renderer.session.scene(), object_id, pose, frame, (row, col))

    def pivot_point(self, voxel: Voxel, object_id: int, frame: Frame) -> Vector:
        """Return where a voxel is seen now, pivot space mm.

        Parameters
        ----------
        voxel : (int, int, int)
            z y x.
        object_id : int
            Whose it is, 0 for no object's: those stay in the bag.
        frame : Frame
            What the canvas shows.
        """
        session = self._renderer.session
        there = np.asarray(voxel, dtype=np.float64) * session.spacing
        if not object_id:
            return transform_points(frame.camera.pivot_from_world(), there)
        center = session.boxes.center(object_id, session.spacing)
        pose = self.pose_of(object_id, frame)
        return transform_points(pose.pivot_from_world(center), there)
