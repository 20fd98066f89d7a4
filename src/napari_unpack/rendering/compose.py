"""Images of a scene: the packed bag, single objects, sprites, and all of them together.

These are the three layers of Li et al. 2012, section 5.3: the packed bag, objects in flight,
sprites. The plugin's layers show the same image patches as quads.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from napari_unpack.appearance import Decorations
from napari_unpack.geometry.axes import transform_points
from napari_unpack.geometry.transforms import Pose, Projection
from napari_unpack.geometry.view import Camera
from napari_unpack.memory import check_picture
from napari_unpack.rendering.decorated_image import box_patch, on_background
from napari_unpack.rendering.image_patch import Image, ImagePatch, Window, compose, nothing
from napari_unpack.rendering.object_casting import cast_subvolume
from napari_unpack.rendering.rulers import Pixels, ruler_pixels, with_rulers
from napari_unpack.rendering.scene import Scene, appearance_alone, packed_appearance
from napari_unpack.rendering.upsampling import upsampled

# Samples a voxel edge of what stands still: a thin coin shows stripes with one.
SAMPLES_AT_REST = 3


def packed_image(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    step_scale: float = 1.0,
    backend: str = "auto",
) -> ImagePatch:
    """Cast what is packed, in the window of the image that the volume's box covers.

    Parameters
    ----------
    scene : Scene
    camera : Camera
    size : (int, int)
        Height and width of the image, pixels.
    step_scale : float
        Distance of samples in the smallest voxel edge; 2 is quicker and coarser.
    backend : {"auto", "cpu", "gl"}
    """
    # The subvolume first: tints may be of more objects than the labels have, never of fewer.
    subvolume = scene.subvolumes.whole()
    return cast_subvolume(
        subvolume, None, camera, size, packed_appearance(scene, step_scale, backend)
    )


def object_image(
    scene: Scene,
    object_id: int,
    pose: Pose,
    camera: Camera,
    size: tuple[int, int],
    step_scale: float = 1.0,
    backend: str = "auto",
    *,
    smooth: bool = False,
    part: Window | None = None,
) -> ImagePatch:
    """Cast one object where a pose places it, in its projected box; no pixels if that is out.

    Parameters
    ----------
    scene : Scene
    object_id : int
    pose : Pose
        Where it is, in the pivot space of the camera.
    camera : Camera
    size : (int, int)
        Height and width of the whole image, pixels.
    step_scale : float
        Distance of samples in the object's own smallest voxel edge.
    backend : {"auto", "cpu", "gl"}
    smooth : bool
        Cast a small object from a finer grid (`upsampling.upsampled`), without stairs.
    part : (int, int, int, int), optional
        First row, first column, height and width of what is wanted of the image.

    Raises
    ------
    KeyError
        If there is no such object.

    Notes
    -----
    Li et al. 2012, eq. 3: rays are mapped back by T^-1 into the packed volume. The samples are
    those of `geometry.rays`, so at its packed pose an object looks as it does in the bag.
    """
    cache = scene.subvolumes
    subvolume = cache.of_object(object_id)
    if smooth:
        subvolume = cache.keep(
            ("upsampled", object_id),
            lambda: upsampled(cache.of_object(object_id), object_id, scene.spacing, cache.air),
        )
    moved = pose.world_from_world(subvolume.center, camera)
    appearance = appearance_alone(scene, object_id, subvolume, step_scale, backend)
    return cast_subvolume(subvolume, moved, camera, size, appearance, part)


def sprite_image(
    scene: Scene,
    object_id: int,
    pose: Pose,
    pixels_per_mm: float,
    step_scale: float = 1.0,
    backend: str = "auto",
    part: Window | None = None,
    smooth: bool = True,
) -> ImagePatch:
    """Cast the small image of an unpacked object.

    Parameters
    ----------
    scene : Scene
    object_id : int
    pose : Pose
        Its turn and scale; where it is does not matter.
    pixels_per_mm : float
        Resolution in pivot space.
    step_scale, backend
        As for `object_image`, but with `SAMPLES_AT_REST` times the samples: a sprite is small,
        and cast once.
    part : (int, int, int, int), optional
        First row, first column, height and width of what is wanted, counted like `row` and `col`.
    smooth : bool
        As for `object_image`; without it a small object takes a third of the time.

    Returns
    -------
    ImagePatch
        Orthographic, on a transparent ground, no row or column empty at its border. `row` and
        `col` count from the pixel whose centre is the object's box centre, so the quad's top
        left corner is (row - 0.5, col - 0.5) / pixels_per_mm from `pose.center` along the
        pivot's axes down and right. Depth and plane are relative to the box centre.

    Raises
    ------
    ValueError
        If the resolution is not positive.
    KeyError
        If there is no such object.
    """
    if not (np.isfinite(pixels_per_mm) and pixels_per_mm > 0):
        raise ValueError(f"pixels_per_mm must be a positive number, got {pixels_per_mm!r}")
    still = replace(pose, center=np.zeros(3))
    down, right = _reach(scene, object_id, still, pixels_per_mm)
    size = 2 * down + 1, 2 * right + 1
    if part is not None:
        part = part[0] + down, part[1] + right, *part[2:]
    # Orthographic, in pivot space: the quad that shows it is turned to the viewer.
    camera = Camera(np.eye(3), np.zeros(3), size[0] / pixels_per_mm, stretch=pose.stretch)
    # A sprite stands still and is drawn once, so it gets the samples of an image at rest.
    step = step_scale / SAMPLES_AT_REST
    whole = object_image(
        scene, object_id, still, camera, size, step, backend, smooth=smooth, part=part
    )
    patch = whole.trimmed()
    return patch.at(patch.row - down, patch.col - right, patch.plane)


def _reach(scene: Scene, object_id: int, pose: Pose, pixels_per_mm: float) -> tuple[int, int]:
    """Return how far a sprite reaches from its middle, up or down and to the sides, pixels."""
    subvolume = scene.subvolumes.of_object(object_id)
    corners = transform_points(pose.pivot_from_world(subvolume.center), subvolume.corners)
    down, right = np.ceil(np.abs(corners - pose.center).max(0)[1:] * pixels_per_mm)
    return int(down), int(right)


# Opacity of everything else while one object is inspected.
DIMMED = 0.16
# How much of the image's shorter side an inspected object's bounding sphere fills.
SHARE_OF_VIEW = 0.72


def scene_image(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    time: float | None = None,
    backend: str = "auto",
    decorations: Decorations | None = None,
    smooth: bool = True,
) -> Image:
    """Put together what a person sees, premultiplied: the bag, flights, sprites, the inspected.

    Parameters
    ----------
    scene : Scene
        What is packed, in the air and unpacked.
    camera : Camera
    size : (int, int)
        Height and width of the image, pixels.
    time : float, optional
        When, for every flight in the air (see `Flight.pose`). Without it flights are not drawn.
    backend : {"auto", "cpu", "gl"}
    decorations : Decorations, optional
        Background, box and scale bar; by default the scene's.
    smooth : bool
        Whether sprites are without stairs; see `sprite_image`.

    Raises
    ------
    ValueError
        If the image does not fit into memory.

    Notes
    -----
    The packed bag and the sprites are cast again only when something they depend on has
    changed (section 5.3), so a frame of a flight costs the cast of the flying objects.
    """
    check_picture(size)
    cache = scene.subvolumes
    packed = packed_appearance(scene, 1.0, backend)
    # Flights and sprites are not in the key: the bag stands while they move.
    key = ("packed", packed.key, _camera_key(camera), size)
    patches = [cache.keep(key, lambda: packed_image(scene, camera, size, 1.0, backend))]
    around = scene.decorations if decorations is None else decorations
    if around.box:
        patches.append(box_patch(scene.boxes, scene.spacing, camera, size, around))
    inspected = scene.inspected
    for object_id, pose in scene.poses.items():
        # What flies or is inspected is drawn below, at another pose.
        if object_id not in scene.flights and object_id not in inspected:
            patches.append(_placed_sprite(scene, object_id, pose, camera, size, backend, smooth))
    if time is not None:
        for i, flight in scene.flights.items():
            pose = flight.pose(time, camera)
            # So that it does not jump where its sprite follows.
            flat = pose.cast_camera(camera, flight.flatness(time, camera))
            patches.append(object_image(scene, i, pose, flat, size, 1.0, backend))
    whole = compose(size, patches)
    if inspected:
        patches = [ImagePatch(DIMMED * whole, np.full(size, np.inf, np.float32), 0, 0, np.inf)]
        for i in inspected:
            pose, fine = _inspected_pose(scene, i, camera, size), 1.0 / SAMPLES_AT_REST
            patches.append(object_image(scene, i, pose, camera, size, fine, backend, smooth=True))
        whole = compose(size, patches)
    drawn = _rulers_drawn(scene, camera, size, time)
    return with_rulers(on_background(whole, camera, around), drawn, around.background.is_light)


def _rulers_drawn(
    scene: Scene, camera: Camera, size: tuple[int, int], time: float | None
) -> list[tuple[Pixels, tuple[str, ...]]]:
    """Return points and numbers of the rulers that can be drawn now."""

    def projection_of(object_id: int) -> Projection | None:
        flatness = 0.0
        if object_id in scene.inspected:
            pose = _inspected_pose(scene, object_id, camera, size)
        elif object_id in scene.flights:
            if time is None:
                return None
            flight = scene.flights[object_id]
            pose, flatness = flight.pose(time, camera), flight.flatness(time, camera)
        elif object_id in scene.poses:
            pose, flatness = scene.poses[object_id], 1.0
        else:
            apart = object_id in scene.mean_densities and object_id not in scene.packed
            return None if apart else Projection(camera.pivot_from_world(), camera)
        center = scene.boxes.center(object_id, scene.spacing)
        return pose.projection(center, camera, flatness)

    found = []
    for ruler in scene.rulers:
        # Objects deleted since belong to the bag as such.
        owners = frozenset(i if i in scene.mean_densities else 0 for i in ruler.owners)
        # The inspected object stands before all others, and before what was measured on them.
        if not scene.inspected or owners == frozenset(scene.inspected):
            pixels = ruler_pixels(owners, ruler.points, projection_of, size)
            if pixels is not None:
                found.append((pixels, ruler.numbers))
    return found


def _inspected_pose(scene: Scene, object_id: int, camera: Camera, size: tuple[int, int]) -> Pose:
    spacing = scene.spacing
    diameter = 2 * scene.boxes.radius(object_id, spacing, camera.stretch)
    # Of the shorter side, so that it fits an upright image too.
    height = camera.height * min(1.0, size[1] / size[0])
    waiting = scene.poses.get(object_id)
    rotation = camera.rotation if waiting is None else waiting.rotation
    return Pose(np.zeros(3), rotation, SHARE_OF_VIEW * height / diameter, camera.stretch)


def _placed_sprite(
    scene: Scene,
    object_id: int,
    pose: Pose,
    camera: Camera,
    size: tuple[int, int],
    backend: str,
    smooth: bool,
) -> ImagePatch:
    flat = camera.flattened(float(pose.center[0]))
    if flat is None:
        return nothing()
    resolution = size[0] / flat.height
    subvolume = scene.subvolumes.of_object(object_id)
    appearance = appearance_alone(scene, object_id, subvolume, 1.0, backend)
    held = pose.rotation.tobytes(), pose.stretch.tobytes(), pose.scale
    # Rounded: napari's zoom is not exact to the last bit, and a sprite need not be either.
    row, col = (int(n) for n in np.rint(flat.pixels(pose.center, size)))
    down, right = _reach(scene, object_id, pose, resolution)
    if not (-down <= row < size[0] + down and -right <= col < size[1] + right):
        return nothing()
    # Near the eye a sprite is far larger than the image: only what is in the image is cast.
    part = (-row, -col, *size) if 2 * down >= size[0] or 2 * right >= size[1] else None
    key = ("sprite", appearance.key, *held, f"{resolution:.7g}", part, smooth)
    patch: ImagePatch = scene.subvolumes.keep(
        key,
        lambda: sprite_image(scene, object_id, pose, resolution, 1.0, backend, part, smooth),
    )
    return patch.at(patch.row + row, patch.col + col, patch.plane - pose.center[0])


def _camera_key(camera: Camera) -> tuple[bytes, bytes, float, float]:
    return camera.linear.tobytes(), camera.center.tobytes(), camera.height, camera.fov
