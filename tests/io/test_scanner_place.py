"""A voxel lies where the file says in the scanner, whatever is made of it and saved."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from napari_unpack.geometry.transforms import rotation_about
from napari_unpack.io import (
    Scan,
    load_labels,
    load_volume,
    open_session,
    save_scan,
    save_session,
    save_surfaces,
)
from napari_unpack.io.headless import open_scan, packed_copy
from napari_unpack.session.containers import open_container

sitk = pytest.importorskip("SimpleITK")

SPACING = (2.0, 0.5, 1.0)
ORIGIN = (-120.0, 45.5, 300.0)
# Turned, flipped to the head and turned to the front, and as plain arrays are.
DIRECTIONS = {
    "oblique": rotation_about((0.2, 1.0, 0.4), 0.5),
    "to the head": np.diag([-1.0, -1.0, 1.0]),
    "coronal": np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]),
    "plain": np.eye(3),
}
CORNER = (3, 30, 9)


def bag() -> np.ndarray:
    """Return a ball of 1000 in a corner, whose middle voxel is 1500, and a hollow box."""
    z, y, x = np.indices((20, 48, 30))
    ball = ((z - CORNER[0]) * 2.0) ** 2 + ((y - CORNER[1]) * 0.5) ** 2 + (x - CORNER[2]) ** 2 < 20
    volume = np.where(ball, 1000, 0).astype(np.int16)
    volume[CORNER] = 1500
    volume[8:17, 4:40, 12:28] = 800
    volume[10:15, 8:36, 15:25] = 2400
    return volume


def written(path: Path, direction: np.ndarray) -> np.ndarray:
    """Write the bag and return where its ball is, mm x y z, as ITK says."""
    image = sitk.GetImageFromArray(bag())
    image.SetSpacing(SPACING[::-1])
    image.SetOrigin(ORIGIN)
    image.SetDirection(direction.ravel().tolist())
    sitk.WriteImage(image, str(path))
    return np.array(image.TransformIndexToPhysicalPoint(CORNER[::-1]))


def brightest(volume: Any, spacing: Any, place: Any, value: int = 1500) -> np.ndarray:
    """Return where the middle of the ball is, by a scan's own numbers."""
    (index,) = np.argwhere(np.asarray(volume) == value)
    return place[:3, :3] @ (index * np.asarray(spacing)) + place[:3, 3]


@pytest.mark.parametrize("suffix", [".nii.gz", ".nrrd", ".mha"])
@pytest.mark.parametrize("name", DIRECTIONS)
def test_what_is_saved_lies_on_the_scan(tmp_path: Path, name: str, suffix: str) -> None:
    there = written(tmp_path / f"bag{suffix}", DIRECTIONS[name])
    scan = load_volume(tmp_path / f"bag{suffix}")
    np.testing.assert_allclose(
        brightest(scan.volume, scan.spacing, scan.scanner_from_scan), there, atol=1e-3
    )
    labels = (np.asarray(scan.volume) == 1500).astype(np.uint8)
    for end in (".mha", ".npz"):
        *_, last = save_scan(scan.with_labels(labels), tmp_path / f"found{end}")
        if end == ".npz":
            again = load_volume(last)
            found = brightest(again.labels, again.spacing, again.scanner_from_scan, 1)
        else:
            image = sitk.ReadImage(str(last))
            (index,) = np.argwhere(sitk.GetArrayFromImage(image) == 1)
            found = image.TransformIndexToPhysicalPoint([int(i) for i in index[::-1]])
        np.testing.assert_allclose(found, there, atol=1e-3)


@pytest.mark.parametrize("name", ["oblique", "plain"])
def test_surfaces_lie_on_the_scan_also_of_saved_sessions_and_opened_objects(
    tmp_path: Path, name: str
) -> None:
    trimesh = pytest.importorskip("trimesh")
    there = written(tmp_path / "bag.nii", DIRECTIONS[name])
    scan = load_volume(tmp_path / "bag.nii")
    volume = np.asarray(scan.volume)
    ids = np.where(np.isin(volume, [1000, 1500]), 1, np.where(volume > 0, 2, 0)).astype(np.uint8)
    session = open_scan(scan.with_labels(ids), (1.0, 0.0, 0.0))
    save_session(session, tmp_path / "bag.unpack")
    for one in (session, packed_copy(session), open_session(tmp_path / "bag.unpack")):
        mesh = trimesh.load_mesh(save_surfaces(one, tmp_path / "ball.stl", [1]))
        # The ball is cut off by the scan's first slice, so that its middle is a little off.
        np.testing.assert_allclose(mesh.center_mass, there, atol=0.6)
    filling = open_container(session, 2)
    outer = trimesh.load_mesh(save_surfaces(session, tmp_path / "box.stl", [2]))
    inner = trimesh.load_mesh(save_surfaces(filling, tmp_path / "in.stl"))
    np.testing.assert_allclose(inner.bounds, outer.bounds, atol=0.3)


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz", ".nrrd", ".mha", ".tif"])
def test_a_scan_without_a_place_has_the_same_surfaces_from_every_format(
    tmp_path: Path, suffix: str
) -> None:
    trimesh = pytest.importorskip("trimesh")
    # Longest along x and shortest along z, each arm from one corner: no turn makes it its mirror
    # image.
    labels = np.zeros((20, 30, 40), np.uint16)
    labels[2:12, 2:6, 2:6] = labels[2:6, 2:20, 2:6] = labels[2:6, 2:6, 2:34] = 1
    scan = Scan(labels * 900, SPACING, labels)
    paths = save_scan(scan, tmp_path / f"bag{suffix}")
    back = load_volume(paths[0])
    np.testing.assert_array_equal(back.volume, labels * 900)
    np.testing.assert_array_equal(load_labels(paths[1])[0], labels)
    assert back.spacing == pytest.approx(SPACING)
    session = open_scan(back.with_labels(labels), (1.0, 0.0, 0.0))
    mesh = trimesh.load_mesh(save_surfaces(session, tmp_path / "bag.stl"))
    # To the left, to the back, and z from the head to the feet: the first slice is the highest.
    np.testing.assert_allclose(mesh.bounds, [[1.5, 0.75, -23.0], [33.5, 9.75, -3.0]], atol=0.3)
    if suffix != ".tif":
        image = sitk.ReadImage(str(paths[0]))
        assert image.TransformIndexToPhysicalPoint((33, 2, 2)) == pytest.approx((33.0, 1.0, -4.0))


def test_a_place_that_is_none_is_refused(tmp_path: Path) -> None:
    place = np.diag([1.0, 1.0, 3.0, 1.0])
    np.savez(tmp_path / "bag.npz", volume=bag(), spacing=SPACING, scanner_from_scan=place)
    with pytest.raises(ValueError, match="where its scan lies"):
        load_volume(tmp_path / "bag.npz")


@pytest.mark.parametrize("name", DIRECTIONS)
def test_a_chosen_time_point_lies_where_its_file_says(tmp_path: Path, name: str) -> None:
    one = sitk.GetImageFromArray(bag())
    image = sitk.JoinSeries([one * 0, one])
    turned = np.eye(4)
    turned[:3, :3] = DIRECTIONS[name]
    image.SetSpacing((*SPACING[::-1], 1.0))
    image.SetOrigin((*ORIGIN, 0.0))
    image.SetDirection(turned.ravel().tolist())
    sitk.WriteImage(image, str(tmp_path / "bag.nii.gz"))
    there = image.TransformIndexToPhysicalPoint((*CORNER[::-1], 1))[:3]
    scan = load_volume(tmp_path / "bag.nii.gz", {"t": 1})
    found = brightest(scan.volume, scan.spacing, scan.scanner_from_scan)
    np.testing.assert_allclose(found, there, atol=1e-3)


def test_an_ome_zarr_lies_where_its_transforms_say(tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr")
    group = zarr.open_group(str(tmp_path / "bag.zarr"), mode="w", zarr_format=2)
    group.create_array("0", data=np.stack([bag() * 0, bag()]))
    move = {"type": "translation", "translation": [0, 300.0, 45.5, -120.0]}
    level = [{"type": "scale", "scale": [1, *SPACING]}, move]
    whole = [{"type": "scale", "scale": [1, 2, 2, 2]}]
    axes = [{"name": a, "unit": "micrometer"} for a in "czyx"]
    group.attrs["multiscales"] = [
        {
            "axes": axes,
            "datasets": [{"path": "0", "coordinateTransformations": level}],
            "coordinateTransformations": whole,
        }
    ]
    scan = load_volume(tmp_path / "bag.zarr", {"c": 1})
    there = 2e-3 * (np.multiply(CORNER, SPACING)[::-1] + ORIGIN)
    found = brightest(scan.volume, scan.spacing, scan.scanner_from_scan)
    np.testing.assert_allclose(found, there, atol=1e-9)
