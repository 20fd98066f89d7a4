"""The backend on the graphics card: shaders in an offscreen context, arrays in and arrays out.

Textures of the last few volumes are kept. They are known by the identity of their arrays, so an
array that was changed in place must be announced with `forget`.
"""

from __future__ import annotations

import weakref
from functools import cache
from typing import TYPE_CHECKING, Any

import networkx as nx
import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.appearance import interference as interference_on_cpu
from napari_unpack.appearance.interference_graph import half_widths
from napari_unpack.geometry.boxes import LabelBoxes
from napari_unpack.geometry.occlusion_counts import MOST_IN_TABLE, OcclusionCounts
from napari_unpack.geometry.rays import Rays
from napari_unpack.geometry.shading import Shading
from napari_unpack.rendering.gl import compute_program, offscreen
from napari_unpack.rendering.gl.framebuffer import NO_DEPTH, Targets
from napari_unpack.rendering.gl.host_memory import HostMemory
from napari_unpack.rendering.gl.interference_pass import InterferencePass
from napari_unpack.rendering.gl.object_id_pass import LAYERS_A_PASS, MOST_LAYERS, ObjectIdPass
from napari_unpack.rendering.gl.occlusion_atomics import OcclusionAtomics, RayTooCrowdedError
from napari_unpack.rendering.gl.occlusion_queries import MOST_QUERIED, FirstHits, OcclusionQueries
from napari_unpack.rendering.gl.programs import ShaderError
from napari_unpack.rendering.gl.textures import Density, VolumeTextures
from napari_unpack.rendering.gl.tinted_pass import Appearance, TintedPass

if TYPE_CHECKING:
    from napari_unpack.rendering.cpu import Bricks


def id_layers(
    labels: NDArray[np.uint16],
    rays: Rays,
    visible: NDArray[np.bool_],
    layers: int = 1,
    bricks: Bricks | None = None,
    clipping: ArrayLike | None = None,
) -> NDArray[np.int32]:
    """List the distinct visible objects on every ray; see `rendering.cpu.id_layers`.

    Parameters
    ----------
    labels, rays, visible, layers, bricks, clipping
        As there.

    Raises
    ------
    ValueError
        Beyond 32 layers or 8 clipping planes.
    RuntimeError
        If there is no offscreen GL, with the reason.
    """
    with offscreen.context().use():
        workspace = workspace_here()
        passes = -(-min(layers, MOST_LAYERS) // LAYERS_A_PASS)
        targets = [kept.get(rays.size) for kept in workspace.id_targets[:passes]]
        workspace.ids.draw(
            targets,
            workspace.textures(labels, None),
            rays,
            visible,
            layers,
            None if bricks is None else bricks.inhabited(visible),
            clipping,
        )
        stacked = np.concatenate([t.read() for t in targets], axis=2)[:, :, :layers]
    return np.ascontiguousarray(np.moveaxis(stacked, 2, 0)).astype(np.int32)


def occlusion_counts(
    labels: NDArray[np.uint16],
    rays: Rays,
    visible: NDArray[np.bool_],
    bricks: Bricks | None = None,
) -> OcclusionCounts:
    """Count how much of every object is hidden by others; see `rendering.cpu.occlusion_counts`.

    Parameters
    ----------
    labels, rays, visible, bricks
        As there.

    Raises
    ------
    RuntimeError
        If there is no offscreen GL, with the reason.

    Notes
    -----
    The CPU counts where the driver is older than OpenGL 4.3, there are more than 4096 objects,
    or a ray meets more than 96.
    """
    from napari_unpack.rendering.cpu import occlusion_counts as counts_on_cpu

    with offscreen.context().use():
        if compute_program.supported() and np.count_nonzero(visible) <= MOST_IN_TABLE:
            try:
                return counts_by_atomics(labels, rays, visible, bricks)
            except (RayTooCrowdedError, ShaderError):
                pass
    return counts_on_cpu(labels, rays, visible, bricks)


def counts_by_atomics(
    labels: NDArray[np.uint16],
    rays: Rays,
    visible: NDArray[np.bool_],
    bricks: Bricks | None = None,
) -> OcclusionCounts:
    """Count occlusion in one pass with atomic counters, within the limits of the shader.

    Parameters
    ----------
    labels, rays, visible, bricks
        As for `occlusion_counts`; at most 4096 visible objects.

    Raises
    ------
    RuntimeError
        If there is no offscreen GL with OpenGL 4.3, or a ray meets more than 96 objects.
    """
    with offscreen.context().use():
        workspace = workspace_here()
        occupied = None if bricks is None else bricks.inhabited(visible)
        textures = workspace.textures(labels, None)
        return workspace.atomics.count(textures, rays, visible, occupied)


def interference(ids: NDArray[np.integer], distance: float = 5) -> nx.Graph:
    """Join the objects that come near one another; see `appearance.interference`.

    Parameters
    ----------
    ids : (layers, H, W) ndarray of int
        Object-ID layers.
    distance : float
        DT of Li et al. 2012, eq. 1, pixels.

    Raises
    ------
    RuntimeError
        If there is no offscreen GL, with the reason.

    Notes
    -----
    The CPU computes it where the driver is older than OpenGL 4.3, there are more than 4096
    objects, or a pixel comes near more than 64.
    """
    found = None if ids.size == 0 else _interfering_pairs(ids, half_widths(distance))
    if found is None:
        return interference_on_cpu(ids, distance)
    present, pairs, lengths = (array.tolist() for array in found)
    graph = nx.Graph()
    graph.add_nodes_from(present)
    for (a, b), length in zip(pairs, lengths, strict=True):
        graph.add_edge(a, b, weight=length)
    return graph


def _interfering_pairs(
    ids: NDArray[np.integer], widths: NDArray[np.integer]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]] | None:
    """Return `InterferencePass.pairs`, None beyond the limits of the shader."""
    with offscreen.context().use():
        if not compute_program.supported():
            return None
        try:
            return workspace_here().interference.pairs(ids, widths)
        except (RayTooCrowdedError, ShaderError, ValueError):
            return None


def first_hits(
    labels: NDArray[np.uint16],
    rays: Rays,
    visible: NDArray[np.bool_],
    boxes: LabelBoxes,
    bricks: Bricks | None = None,
) -> FirstHits:
    """Count every object's rays, and its blocked ones, by occlusion queries.

    Parameters
    ----------
    labels, rays, visible, bricks
        As for `occlusion_counts`.
    boxes : LabelBoxes

    Raises
    ------
    ValueError
        Above 256 objects, or in perspective.
    RuntimeError
        If there is no offscreen GL, with the reason.
    """
    asked = int(np.count_nonzero(visible[boxes.ids]))
    if asked > MOST_QUERIED:
        raise ValueError(
            f"occlusion queries serve up to {MOST_QUERIED} objects, got {asked}; "
            'use the method "one_pass"'
        )
    if rays.near != -np.inf:
        raise ValueError("occlusion queries need parallel rays, got a perspective")
    with offscreen.context().use():
        workspace = workspace_here()
        textures = workspace.textures(labels, None)
        first = workspace.id_targets[0].get(rays.size)
        occupied = None if bricks is None else bricks.inhabited(visible)
        workspace.ids.draw([first], textures, rays, visible, 1, occupied)
        target = workspace.counting_targets.get(rays.size)
        return workspace.queries.count(target, first, textures, rays, boxes, visible)


def tinted(
    volume: Density,
    labels: NDArray[np.uint16],
    rays: Rays,
    spacing: ArrayLike,
    table: NDArray[np.float32],
    domain: tuple[float, float],
    tints: NDArray[np.float32],
    shading: Shading | None,
    bricks: Bricks | None = None,
    jitter: bool = False,
    clipping: ArrayLike | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Cast a tinted image, colour and depth; see `rendering.cpu.tinted`.

    Parameters
    ----------
    volume, labels, rays, spacing, table, domain, tints, shading, bricks, jitter, clipping
        As there.

    Raises
    ------
    RuntimeError
        If there is no offscreen GL, with the reason.
    """
    with offscreen.context().use():
        workspace = workspace_here()
        target = workspace.tinted_targets.get(rays.size)
        workspace.tinted.draw(
            target,
            workspace.textures(labels, volume),
            rays,
            Appearance(spacing, table, domain, tints, shading),
            None if bricks is None else bricks.occupied(table, domain, tints),
            jitter,
            clipping,
        )
        image = target.read(0, workspace.memory)
        depth = target.read(1, workspace.memory)[:, :, 0]
    np.copyto(depth, np.float32(np.inf), where=depth >= NO_DEPTH)
    return image, depth


def forget(array: NDArray[Any] | None = None) -> None:
    """Drop the textures made from an array, or all of them."""
    with offscreen.context().use():
        workspace_here().forget(array)


class Workspace:
    """Passes, targets and textures of the offscreen context."""

    # Volumes whose textures stay.
    keep = 2

    def __init__(self) -> None:
        self.ids = ObjectIdPass()
        self.tinted = TintedPass()
        self.atomics = OcclusionAtomics()
        self.queries = OcclusionQueries()
        self.interference = InterferencePass()
        # One for each pass of as many layers as there may be.
        self.id_targets = [Targets((4,)) for _ in range(MOST_LAYERS // LAYERS_A_PASS)]
        self.counting_targets = Targets((1,), keep=1)
        self.tinted_targets = Targets(TintedPass.channels)
        self.memory = HostMemory()
        self._kept: dict[tuple[int, int], tuple[Any, Any, VolumeTextures]] = {}

    def textures(self, labels: NDArray[np.uint16], volume: Density | None) -> VolumeTextures:
        """Return the textures of these very arrays, uploading them if they are new.

        Parameters
        ----------
        labels : (Z, Y, X) ndarray of uint16
        volume : (Z, Y, X) ndarray, optional
            Density; None where labels alone are drawn.

        Raises
        ------
        ValueError
            If the volume is larger than the driver's textures.
        """
        for key, (label_ref, volume_ref, textures) in list(self._kept.items()):
            # Textures go with their arrays: an identity may be used again.
            if label_ref() is None or (volume_ref is not None and volume_ref() is None):
                self._kept.pop(key)[2].delete()
            elif label_ref() is labels and (
                volume is None or (volume_ref is not None and volume_ref() is volume)
            ):
                self._kept[key] = self._kept.pop(key)
                return textures
        textures = VolumeTextures(labels, volume)
        if textures.factor != (1, 1, 1):
            # Coarser IDs would be other answers than the processor's, which has no such limit.
            textures.delete()
            size = "x".join(map(str, labels.shape))
            raise ValueError(f'volume ({size}) is too large for this graphics driver; use "cpu"')
        textures.send()
        volume_ref = None if volume is None else weakref.ref(volume)
        self._kept[id(labels), id(volume)] = (weakref.ref(labels), volume_ref, textures)
        # The least recently used go first: volumes are large.
        while len(self._kept) > self.keep:
            self._kept.pop(next(iter(self._kept)))[2].delete()
        return textures

    def forget(self, array: NDArray[Any] | None) -> None:
        """Drop the textures made from an array, or all and the memory of pictures."""
        if array is None:
            self.memory = HostMemory()
        for key, (label_ref, volume_ref, textures) in list(self._kept.items()):
            if array is None or array is label_ref() or (volume_ref and array is volume_ref()):
                del self._kept[key]
                textures.delete()


@cache
def workspace_here() -> Workspace:
    """Return the workspace of the offscreen context."""
    return Workspace()
