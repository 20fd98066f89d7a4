"""Ray casting in the canvas's own GL context: when it serves, and what it keeps there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from napari_unpack.appearance import TransferFunction, tints_of
from napari_unpack.geometry.axes import Matrix, transform_points
from napari_unpack.geometry.boxes import box_corners
from napari_unpack.geometry.rays import Rays
from napari_unpack.geometry.view import Camera
from napari_unpack.layers.rendered_image import CanvasImage, Window
from napari_unpack.rendering.casting import TABLE_ENTRIES, rays_for
from napari_unpack.rendering.gl import formats, framebuffer
from napari_unpack.rendering.gl.cached_pass import TintedCaster, Where
from napari_unpack.rendering.gl.depth_quads import ImageTexture
from napari_unpack.rendering.gl.framebuffer import PixelWindow
from napari_unpack.rendering.gl.offscreen import is_software_renderer
from napari_unpack.rendering.gl.programs import Programs
from napari_unpack.rendering.gl.tinted_pass import Appearance
from napari_unpack.rendering.gl.volume_store import VolumeStore
from napari_unpack.rendering.image_patch import window_of
from napari_unpack.rendering.scene import LIGHT
from napari_unpack.rendering.subvolumes import Subvolume
from napari_unpack.viewer.animation import Moving
from napari_unpack.viewer.dirty_region import window_of_objects

if TYPE_CHECKING:
    from napari_unpack.session import Session

# Around an object's box that its fringe reaches; see `geometry.grow_labels`.
FRINGE_VOXELS = 2

# What is sent to the graphics card while the canvas draws one frame: a few milliseconds.
BYTES_A_FRAME = 16 * 2**20


class _Shown(NamedTuple):
    """How what is cast looks, known only when it is cast: hues may be on their way until then."""

    tints: NDArray[np.float32]
    clipping: NDArray[np.float64] | None
    function: TransferFunction


@dataclass(frozen=True, eq=False)
class _Known:
    """An appearance, and which bricks it leaves empty."""

    function: TransferFunction
    appearance: Appearance
    occupied: NDArray[np.bool_]


class CanvasBackend:
    """Casts with shaders where the canvas's driver is worth it.

    Parameters
    ----------
    session : Session
    failed : callable
        Given a sentence when GL turns out not to serve; the CPU has taken over by then.
    message : callable
        Given a sentence where GL serves, but draws the volume coarser than it is.
    probe : callable
        Given what the driver calls itself, and a callable for the reason why it must not cast, ""
        where it may; see `driver_probe`.

    Attributes
    ----------
    wanted : {"auto", "cpu", "gl"}
        What should cast; "auto" takes GL on graphics hardware and the CPU where the driver is a
        software rasteriser, which our own kernels outrun.
    hues_on_the_way : dict of int to float
        Hues to show in place of the session's, during a transition.

    Notes
    -----
    One density and one label texture serve all images. Images stay on the graphics card, and
    rays are cast only when something they depend on has changed (`TintedCaster`).
    """

    def __init__(
        self,
        session: Session,
        failed: Callable[[str], None],
        message: Callable[[str], None],
        probe: Callable[[str, Callable[[str], None]], None],
    ) -> None:
        self.wanted = "auto"
        self.hues_on_the_way: dict[int, float] = {}
        self._session, self._failed, self._message = session, failed, message
        self._notice: str | None = None
        self._probe = probe
        self._renderer: str | None = None
        self._asked = self._proven = self._broken = False
        self._subvolume: Subvolume | None = None
        self._store: VolumeStore | None = None
        self._ready = self._sent = False
        self._programs = Programs()
        self._casters: dict[object, TintedCaster] = {}
        self._known: dict[object, _Known] = {}
        self._places: dict[int, int] = {}

    @property
    def active(self) -> bool:
        """Whether GL casts, as far as is known by now."""
        return self._serves and self._ready

    @property
    def waiting(self) -> bool:
        """Whether GL is to cast and has not all of the volume or of its newest labels yet."""
        return self._serves and not self._sent

    @property
    def uploads(self) -> int:
        """Volume textures, and boxes of labels, sent so far."""
        return 0 if self._store is None else self._store.uploads

    @property
    def bytes_sent(self) -> int:
        """Of volume textures so far."""
        return 0 if self._store is None else self._store.bytes_sent

    @property
    def rays_cast(self) -> int:
        """Rays cast so far, for all images that are kept."""
        return sum(caster.rays_cast for caster in self._casters.values())

    @property
    def probing(self) -> bool:
        """Whether the driver is being tried."""
        return self._asked and not (self._proven or self._broken)

    @property
    def _serves(self) -> bool:
        return self._proven and self._is_wanted and self._subvolume is not None

    @property
    def _is_wanted(self) -> bool:
        if self.wanted == "cpu" or self._broken or self._renderer is None:
            return False
        # Asked for by name it is used, however slow.
        return self.wanted == "gl" or not is_software_renderer(self._renderer)

    def enter(self) -> None:
        """Look at the driver; to be called while the canvas draws."""
        if self._renderer is None:
            self._renderer, lacks = framebuffer.renderer(), formats.lacking()
            if lacks:
                self._broken = True
                self._failed(
                    f"The graphics driver ({self._renderer}) has no {lacks}: the processor draws "
                    "the 3D view, and slices in napari may stay empty; a newer driver has them."
                )
        self.prove()

    def prove(self) -> None:
        """Have the driver tried if it is to cast and never was; until then the CPU casts."""
        if not self._asked and self._renderer is not None and self._is_wanted:
            self._asked = True
            self._probe(self._renderer, self._tried)

    def _tried(self, reason: str) -> None:
        if reason:
            self._break(reason)
        self._proven = not reason

    def send(self) -> None:
        """Send a piece of what the graphics card lacks; to be called while the canvas draws.

        Until it has all of a volume the CPU goes on casting; until it has newer labels the
        image of those before stays.
        """
        if self._store is None or not self.waiting:
            return
        try:
            self._sent = self._store.send(BYTES_A_FRAME)
        except Exception as error:
            self._break(error)
        # Once ready it stays so: an image of labels a moment old is better than none.
        self._ready = self._ready or self._sent

    def context_replaced(self) -> None:
        """Send everything anew: what was on the graphics card went with its context."""
        self._ready = self._sent = False

    def supply(self, subvolume: Subvolume) -> None:
        """Take over the whole volume, made ready in a worker thread."""
        # Only newer labels are sent where the volume is the same.
        if subvolume is self._subvolume:
            return
        most, edit = int(subvolume.bricks.ids.max(initial=0)), subvolume.edit
        if self._store is not None and edit is not None and edit.of() is self._subvolume:
            if edit.box is not None:
                self._store.set_labels(subvolume.labels, edit.box, most)
                self._sent = False
            self._known.clear()
        else:
            self._free()
            self._store = VolumeStore(subvolume.labels, subvolume.volume, most=most)
        self._subvolume = subvolume

    def packed(
        self,
        camera: Camera,
        size: tuple[int, int],
        step: float,
        done: Callable[[float], None],
    ) -> CanvasImage | None:
        """Return the image of what is packed, to be cast when it is drawn.

        Parameters
        ----------
        camera : Camera
            Where one looks from.
        size : (int, int)
            Height and width of the image, pixels.
        step : float
            Distance of samples, smallest voxel edges.
        done : callable
            Given the seconds it took once it was cast.

        Returns
        -------
        CanvasImage or None
            None where the bag is out of view.
        """
        session = self._session
        ends = np.zeros(3), np.asarray(session.labels.shape) - 1.0

        def look() -> _Shown:
            return _Shown(self.packed_tints(), session.clipping, session.transfer_function)

        return self._image("packed", ends, None, camera, size, step, done, look)

    def moving(
        self,
        moving: Mapping[int, Moving],
        camera: Camera,
        sizes: Callable[[Moving], tuple[tuple[int, int], float]],
        done: Callable[[float], None],
    ) -> dict[int, CanvasImage]:
        """Return images of objects where they are now, without those out of view.

        Parameters
        ----------
        moving : {id: Moving}
        camera, done
            As for `packed`.
        sizes : callable
            Given a Moving: size of the whole image and step.
        """
        # Frame buffers go by place, and serve the next object that moves.
        self._places = {i: k for i, k in self._places.items() if i in moving}
        unused = iter(k for k in range(len(moving)) if k not in self._places.values())
        images = {}
        for object_id, one in moving.items():
            place = self._places.setdefault(object_id, -1)
            if place < 0:
                place = self._places[object_id] = next(unused)
            flat = one.pose.cast_camera(camera, one.flatness)
            image = self._object(object_id, place, one, flat, *sizes(one), done)
            if image is not None:
                # Its pixels are those of the view, whichever rays went through them.
                image.camera, image.in_front = camera, one.in_front
                images[object_id] = image
        return images

    def landed(self) -> None:
        """Free the frame buffers of what moved: nothing moves any more, or is shown moving."""
        self._places.clear()
        for key in [key for key in self._casters if key != "packed"]:
            self._casters.pop(key).close()
            self._known.pop(key, None)

    def close(self) -> None:
        """Free what is on the graphics card; the context need not be current."""
        self._free()
        self._subvolume = None

    def packed_tints(self) -> NDArray[np.float32]:
        """Return the tints by ID of what is packed, hues on their way among them."""
        tints: NDArray[np.float32] = self._session.packed_tints()
        own, on_the_way = self._session.state.colors, self.hues_on_the_way.items()
        shown = {i: hue for i, hue in on_the_way if tints[i].any() and i not in own}
        if shown:
            tints = tints.copy()
            fresh = tints_of(shown, len(tints) - 1, mode=self._session.tint_mode)
            tints[list(shown)] = fresh[list(shown)]
        return tints

    def _object(
        self,
        object_id: int,
        place: int,
        moving: Moving,
        camera: Camera,
        size: tuple[int, int],
        step: float,
        done: Callable[[float], None],
    ) -> CanvasImage | None:
        session = self._session
        row = session.boxes.index(object_id)
        low = np.maximum(session.boxes.lower[row] - FRINGE_VOXELS, 0)
        high = np.minimum(session.boxes.upper[row] + FRINGE_VOXELS, session.labels.shape)
        center = session.boxes.center(object_id, session.spacing)
        moved = moving.pose.world_from_world(center, camera)
        voxels = np.eye(4) if self._subvolume is None else self._subvolume.voxel_from_world

        def look() -> _Shown:
            clipping = session.style(object_id).planes(voxels)
            function = session.transfer_function_of(object_id)
            return _Shown(session.solo_tints(object_id), clipping, function)

        ends = low.astype(float), high - 1.0
        return self._image(place, ends, moved, camera, size, step, done, look)

    def _image(
        self,
        key: object,
        ends: tuple[NDArray[np.float64], NDArray[np.float64]],
        moved: Matrix | None,
        camera: Camera,
        size: tuple[int, int],
        step: float,
        done: Callable[[float], None],
        look: Callable[[], _Shown],
    ) -> CanvasImage | None:
        if self._subvolume is None:
            return None
        spacing = self._session.spacing
        pivot, affine = camera.pivot_from_world(), self._subvolume.voxel_from_world
        if moved is not None:
            pivot, affine = pivot @ moved, affine @ np.linalg.inv(moved)
        corners = box_corners(ends[0] - 0.5, ends[1] + 0.5) * spacing
        found = window_of(transform_points(pivot, corners), camera, size)
        if found is None:
            return None
        plane = -float(transform_points(pivot, (ends[0] + ends[1]) / 2 * spacing)[0])
        window = Window.around(found, plane)

        def develop() -> ImageTexture | None:
            part = window.row, window.col, *window.size
            rays = rays_for(camera, size, spacing, affine, step, part)

            def where(ids: frozenset[int]) -> PixelWindow | None:
                known = set(self._session.boxes.ids.tolist())
                # Only the packed image keeps pixels of before; an object alone is cast whole.
                if moved is not None or not ids <= known:
                    return 0, 0, part[3], part[2]
                found = window_of_objects(self._session.scene(), camera, size, part, ids)
                if found is None:
                    return None
                return found[1] - part[1], found[0] - part[0], found[3], found[2]

            return self._cast(key, rays, look(), done, where)

        return CanvasImage(window, camera, size, develop)

    def _cast(
        self,
        key: object,
        rays: Rays,
        shown: _Shown,
        done: Callable[[float], None],
        where: Where,
    ) -> ImageTexture | None:
        if self._store is None or self._subvolume is None or not self.active:
            return None
        tints, clipping, function = shown
        known = self._appearance(self._subvolume, key, tints, function)
        caster = self._casters.get(key)
        if caster is None:
            caster = self._casters[key] = TintedCaster(self._store, self._programs)
        passes, began = caster.passes, perf_counter()
        # Drivers refuse in every way there is: compiler logs, incomplete buffers, no memory.
        try:
            framebuffer.forget_complaints()
            texture = caster.cast(rays, known.appearance, known.occupied, False, clipping, where)
            # Wait for the card, or the time would be that of asking alone.
            if caster.passes > passes:
                framebuffer.finish()
        except Exception as error:
            self._break(error)
            return None
        if caster.passes > passes:
            done(perf_counter() - began)
        # Once a session is enough.
        if self._notice is None and self._store.notice is not None:
            self._notice = self._store.notice
            self._message(self._notice)
        return texture

    def _break(self, error: Exception | str) -> None:
        self._broken = True
        self._failed(
            f"The graphics card cannot draw the bag ({error}); the processor draws it instead."
        )

    def _appearance(
        self,
        subvolume: Subvolume,
        key: object,
        tints: NDArray[np.float32],
        function: TransferFunction,
    ) -> _Known:
        known = self._known.get(key)
        if (
            known is None
            or known.function is not function
            or not np.array_equal(known.appearance.tints, tints)
        ):
            spacing = self._session.spacing
            # Finding empty bricks takes milliseconds: only after tints or densities changed.
            table = function.table(TABLE_ENTRIES)
            appearance = Appearance(spacing, table, function.domain, tints, LIGHT)
            occupied = subvolume.bricks.occupied(table, function.domain, tints)
            known = self._known[key] = _Known(function, appearance, occupied)
        return known

    def _free(self) -> None:
        for caster in self._casters.values():
            caster.close()
        self._casters.clear()
        self._known.clear()
        self._ready = self._sent = False
        if self._store is not None:
            self._store.delete()
            self._store = None
