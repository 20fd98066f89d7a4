"""Surfaces of objects as triangles: STL, OBJ, PLY and glTF (.glb), for printing and other tools."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter

from napari_unpack.atomic import (
    check_writable,
    checked_target,
    folder_written_atomically,
    holds_only,
    written_atomically,
)
from napari_unpack.geometry.axes import Matrix, transform_points
from napari_unpack.io.optional import needed
from napari_unpack.io.scan import SCANNER_FROM_SCAN
from napari_unpack.session.validation import checked_ids
from napari_unpack.tasks import SILENT, Progress, Share, attended, no_progress, relayed

if TYPE_CHECKING:
    import trimesh

    from napari_unpack.session import Session

FORMATS = (".stl", ".obj", ".ply", ".glb", "")
"""Suffixes; a name without one is a folder of STL files, one for each object."""

# Of the blur that rounds off the stairs of voxels, in voxels: below it stairs show, above it
# edges of a box go.
SMOOTH = 0.7

# Objects of fewer voxels are cut from a grid so many times finer: their surface is mostly stairs.
FINER = ((3_000, 3), (100_000, 2))

# How near the enclosed volume comes to the voxels', as a share, and how many levels are tried:
# on a shell of a large bag each takes seconds.
CLOSE = 0.005
STEPS = 8

# Marching cubes keep all of Python waiting, for 20 to 130 ns a voxel: a slab takes a tenth of a
# second.
SLAB_VOXELS = 2**20

# What is written between two checks.
PIECE_BYTES, PIECE_ROWS = 2**24, 2**15

# A name, which stays empty, and how many triangles follow.
STL_HEADER_BYTES = 84

# No voxel of a blurred mask is nearer to the level: there the surface's points on several edges
# would be one to float32, in bags of up to 2,000 voxels, and slabs could not tell them apart.
NEAR = 0.0001

# glTF counts in metres.
METRES_PER_MM = 0.001

# Systems allow 255 for a file's name; it has a number before and a suffix behind.
MOST_NAME_BYTES = 200


def checked_surfaces_path(path: str | Path) -> Path:
    """Return where surfaces go.

    Raises
    ------
    ValueError
        If its suffix is none of `FORMATS`.
    """
    target = checked_target(path)
    if target.suffix.lower() not in FORMATS:
        raise ValueError(
            "surfaces must end in .stl, .obj, .ply or .glb, or be a folder's name without a suffix "
            f"for one STL file an object; got {target.name!r}"
        )
    return target


def save_surfaces(
    session: Session,
    path: str | Path,
    ids: Iterable[int] | None = None,
    standing: ArrayLike | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write the surfaces of objects where they lie in the scanner, x left, y back, z to the head.

    Parameters
    ----------
    session : Session
        Not changed, so this may run on any thread.
    path : str or Path
        .stl has all objects in one body; .ply their colours too; .obj and .glb have an object of
        its own, with its name and colour, for each. A name without a suffix is a folder of STL
        files. Lengths are in mm, of .glb in metres as glTF wants.
    ids : iterable of int, optional
        By default all objects.
    standing : (4, 4) array_like, optional
        How the bag stands where its layers were moved or turned, see `io.sessions.standing_of`;
        by default as it was scanned.
    progress : callable, optional
        Takes (fraction, text) for every object; raising in it cancels and leaves no file.

    Raises
    ------
    TypeError
        If an ID is no integer.
    ValueError
        If the format or an ID is unknown, or none is given.
    ImportError
        If trimesh is missing.
    """
    target, report = checked_surfaces_path(path), progress or no_progress
    needed("trimesh", "writing surfaces")
    # Each once, however often it is named: two surfaces in one place are no solid.
    wanted = checked_ids(session.ids if ids is None else ids, session.states)
    if not wanted:
        raise ValueError("ids must name at least one object, got none")
    check_writable(target)
    meshes = _meshes(session, wanted, standing, report)
    with ExitStack() as stack:
        if not target.suffix:
            folder = stack.enter_context(folder_written_atomically(target, _holds_surfaces))
            for k, (name, mesh) in enumerate(meshes):
                safe = re.sub(r"[^\w .()-]+", "_", name).strip(" .")
                short = safe.encode()[:MOST_NAME_BYTES].decode(errors="ignore")
                number = session.label_of(wanted[k])
                (folder / f"{number:03d} {short}.stl").write_bytes(_exported(mesh, "stl"))
        else:
            temporary = stack.enter_context(written_atomically(target))
            told, kind = Share(report, 1.0, 1.0, "Writing surfaces"), target.suffix.lower()[1:]
            with temporary.open("wb") as file:
                if kind == "stl":
                    _write_stl(file, meshes)
                elif kind == "obj":
                    _write_obj(file, meshes, len(wanted), report)
                else:
                    written = memoryview(attended(partial(_together, list(meshes), kind), told))
                    for first in told.over(range(0, len(written), PIECE_BYTES)):
                        file.write(written[first : first + PIECE_BYTES])
        report(1.0, "Written")
    return target


def object_surface(
    mask: NDArray[np.bool_], progress: Progress = no_progress
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the closed surface of a mask that encloses as much as its voxels are.

    Parameters
    ----------
    mask : (Z, Y, X) ndarray of bool
        With at least one voxel.
    progress : callable
        Told of every slab; raising in it cancels.

    Returns
    -------
    points : (n, 3) ndarray of float64
        Voxels z y x, whose centres are at integers.
    triangles : (m, 3) ndarray of int64
    """
    # Not from 0, where a bar stands still while the blur is made.
    whole = Share(progress, 0.01)
    whole()
    count = int(mask.sum())
    finer = next((times for most, times in FINER if count < most), 1)
    for axis in range(3):
        mask = np.repeat(mask, finer, axis)
    # Room for the blur, so that nothing is cut off at the border.
    margin = 4 * finer
    field = gaussian_filter(np.pad(mask.astype(np.float32), margin), SMOOTH * finer)
    low, high = 0.0, float(field.max())
    level = min(0.5, high / 2)
    # How much more is enclosed at the lower level, and less at the higher one: nothing at the
    # highest, and at 0 about twice what should be.
    more, less, before, nearest = 1.0, -1.0, 0.0, math.inf
    # At one half, corners and thin sheets shrink or go: the level is moved until the surface
    # encloses what it should, to where a line between the two levels does (Illinois algorithm).
    for k in range(STEPS):
        found = level_surface(field, level, whole.part(k / STEPS, (k + 1) / STEPS))
        error = _enclosed(*found) / (count * finer**3) - 1
        if abs(error) < nearest:
            nearest, (points, triangles) = abs(error), found
        if nearest < CLOSE:
            break
        # A level that stays counts half, or steps would grow small; far off, no line is right.
        if error > 0:
            low, more, less = level, min(error, 1.0), less / (2 if before > 0 else 1)
        else:
            high, less, more = level, error, more / (2 if before < 0 else 1)
        before, level = error, low + (high - low) * more / (more - less)
    return (points - margin + 0.5) / finer - 0.5, triangles


def level_surface(
    field: NDArray[np.float32], level: float, share: Share = SILENT, most: int = SLAB_VOXELS
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the surface where a field has a level, as points z y x and triangles.

    Parameters
    ----------
    field : (Z, Y, X) ndarray of float32
        In [0, 1], and below the level all around.
    level : float
    share : Share
        Told of every slab.
    most : int
        Voxels of a slab, roughly; it decides on the order of the points alone.
    """
    from skimage.measure import marching_cubes

    deep = max(1, most // field[0].size)
    found, faces, count, shared = [], [], 0, np.zeros(0, np.int64)
    for first in share.over(range(0, len(field) - 1, deep)):
        # The plane in which two slabs meet is in both, and so are the points in it.
        slab = field[first : first + deep + 1] - np.float32(level)
        np.copysign(np.maximum(np.abs(slab), NEAR), slab, out=slab)
        if slab.min() > 0 or slab.max() < 0:
            shared = shared[:0]
            continue
        points, triangles, _, _ = marching_cubes(slab, 0.0)
        number = np.full(len(points), -1)
        number[_in_plane(points, 0)] = shared
        new = number < 0
        number[new] = count + np.arange(new.sum())
        count += int(new.sum())
        shared = number[_in_plane(points, len(slab) - 1)]
        found.append(points[new] + np.array([first, 0.0, 0.0]))
        faces.append(number[triangles])
    return np.concatenate(found), np.concatenate(faces)


def _in_plane(points: NDArray[np.float32], z: int) -> NDArray[np.int64]:
    """Return which points lie in a plane, in an order that is the same from both of its sides."""
    there = np.flatnonzero(points[:, 0] == z)
    return there[np.lexsort(points[there, 1:].T)]


def _enclosed(points: NDArray[Any], triangles: NDArray[Any]) -> float:
    a, b, c = (points[triangles[:, k]].astype(np.float64) for k in range(3))
    # Each triangle and the origin span a tetrahedron; those that face it count as negative.
    return abs(float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum())) / 6


def _meshes(
    session: Session, ids: list[int], standing: ArrayLike | None, report: Progress
) -> Iterator[tuple[str, trimesh.Trimesh]]:
    names, labels, boxes = session.objects["name"], session.labels, session.boxes
    moved = np.eye(4) if standing is None else np.asarray(standing, dtype=np.float64)
    told = session.scanner_from_scan
    # Beside the surfaces of the bag it was cut out of; where it is told it says so already.
    cut = np.eye(4)
    cut[:3, 3] = session.first_voxel_mm
    place = (SCANNER_FROM_SCAN if told is None else told @ np.linalg.inv(cut)) @ moved @ cut
    # A file may say mm and mean µm: the length unit knows.
    scale = session.length_unit.true_mm
    for k, i in enumerate(ids):
        text = f"Finding surfaces: {k} of {len(ids)}"
        share = Share(report, k / len(ids), (k + 1) / len(ids), text)
        share()
        window = boxes.slices(i)
        # From the object's own voxels to where it lies, in mm.
        there = np.diag([scale, scale, scale, 1.0]) @ place @ np.diag([*session.spacing, 1.0])
        there[:3, 3] += there[:3, :3] @ [one.start for one in window]
        color = np.append(session.solo_tints(i)[i, :3], 1.0)
        yield str(names[i]), relayed(partial(_mesh, labels[window] == i, there, color), share)


def _mesh(
    mask: NDArray[np.bool_], there: Matrix, color: NDArray[np.float64], progress: Progress
) -> trimesh.Trimesh:
    import trimesh

    points, triangles = object_surface(mask, progress)
    mesh = trimesh.Trimesh(transform_points(there, points), triangles, process=False)
    # Two mirrors are none: whichever way the axes go, outside is outside.
    if mesh.volume < 0:
        mesh.invert()
    mesh.visual = trimesh.visual.ColorVisuals(
        mesh, vertex_colors=np.tile(np.uint8(np.clip(color, 0, 1) * 255), (len(points), 1))
    )
    return mesh


def _write_stl(file: BinaryIO, meshes: Iterator[tuple[str, trimesh.Trimesh]]) -> None:
    """Write one body, object after object: all of them at once would keep Python waiting."""
    count = 0
    file.write(bytes(STL_HEADER_BYTES))
    for _, mesh in meshes:
        file.write(_exported(mesh, "stl")[STL_HEADER_BYTES:])
        count += len(mesh.faces)
    file.seek(STL_HEADER_BYTES - 4)
    file.write(count.to_bytes(4, "little"))


def _write_obj(
    file: BinaryIO, meshes: Iterator[tuple[str, trimesh.Trimesh]], count: int, report: Progress
) -> None:
    """Write points with their colour and triangles, as trimesh does, but piece by piece."""
    before = 1
    for k, (name, mesh) in enumerate(meshes, start=1):
        told = Share(report, k / count, k / count, "Writing surfaces")
        file.write(f"o {' '.join(name.split())}\n".encode())
        visual: Any = mesh.visual
        color = visual.vertex_colors[:1, :3] / 255
        points = np.hstack([mesh.vertices, np.repeat(color, len(mesh.vertices), axis=0)])
        for line, rows in (
            ("v" + 3 * " %.9g" + 3 * " %.6f", points),
            ("f %d %d %d", mesh.faces + before),
        ):
            for first in range(0, len(rows), PIECE_ROWS):
                told()
                piece = rows[first : first + PIECE_ROWS]
                file.write(
                    ((line + "\n") * len(piece) % tuple(piece.reshape(-1).tolist())).encode()
                )
        before += len(mesh.vertices)


def _together(meshes: list[tuple[str, trimesh.Trimesh]], kind: str) -> bytes:
    import trimesh

    if kind == "ply":
        return _exported(trimesh.util.concatenate([mesh for _, mesh in meshes]), kind)
    scene = trimesh.Scene()
    for name, mesh in meshes:
        mesh.apply_scale(METRES_PER_MM)
        own, count = name, 1
        # Of two nodes of one name the scene would keep one.
        while own in scene.geometry:
            count += 1
            own = f"{name} ({count})"
        scene.add_geometry(mesh, node_name=own, geom_name=own)
    return _exported(scene, kind)


def _exported(mesh: Any, kind: str) -> bytes:
    written: Any = mesh.export(file_type=kind)
    return written.encode() if isinstance(written, str) else bytes(written)


def _holds_surfaces(folder: Path) -> bool:
    return holds_only(folder, lambda name: bool(re.fullmatch(r"\d{3,} .*\.stl", name)))
