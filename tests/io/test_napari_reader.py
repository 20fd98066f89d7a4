"""What napari's File > Open gets."""

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

import napari_unpack
from napari_unpack.file_sizes import TooLargeError
from napari_unpack.io import Scan, save_scan
from napari_unpack.io.napari_reader import get_reader, read_layers
from napari_unpack.io.ome_zarr import write_labels_zarr

VOLUME = np.arange(60, dtype=np.uint16).reshape(3, 4, 5)


def test_a_scan_becomes_an_image_and_labels_in_mm(tmp_path: Path) -> None:
    labels = (VOLUME > 30).astype(np.uint8)
    scan = Scan(VOLUME, (3.0, 2.0, 1.0), labels, names={1: "Left\nshoe"})
    save_scan(scan, tmp_path / "bag.npz")
    reader = get_reader(str(tmp_path / "bag.npz"))
    assert reader is not None
    image, marks = reader(str(tmp_path / "bag.npz"))
    np.testing.assert_array_equal(image[0], VOLUME)
    assert (image[1]["name"], image[1]["scale"], image[2]) == ("bag", (3.0, 2.0, 1.0), "image")
    np.testing.assert_array_equal(marks[0], labels)
    assert (marks[1]["scale"], marks[2]) == ((3.0, 2.0, 1.0), "labels")
    assert image[1]["units"] == marks[1]["units"] == ("mm", "mm", "mm")
    assert marks[1]["features"] == {"index": [1], "name": ["Left shoe"]}


def test_labels_alone_become_labels(tmp_path: Path) -> None:
    path = tmp_path / "atlas.npz"
    np.savez(path, labels=VOLUME)
    reader = get_reader([str(path)])
    assert reader is not None
    with pytest.warns(UserWarning, match=r"atlas.npz: it gives no voxel size: 1 mm was assumed"):
        ((data, about, kind),) = reader([str(path)])
    assert (data.shape, about["name"], kind) == ((3, 4, 5), "atlas", "labels")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems know no such names")
def test_a_layer_of_a_file_whose_name_is_no_utf8_has_a_name_that_prints(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"Sch\xe4del.npz")
    save_scan(Scan(VOLUME, (3.0, 2.0, 1.0)), path)
    ((_, about, _),) = read_layers(str(path))
    assert about["name"] == "Sch?del"


def test_a_label_image_of_zarr_becomes_labels(tmp_path: Path) -> None:
    path = tmp_path / "found.zarr"
    write_labels_zarr(path, VOLUME.astype(np.int32), (3.0, 2.0, 1.0))
    ((data, about, kind),) = read_layers(str(path))
    np.testing.assert_array_equal(data, VOLUME)
    assert (about["name"], about["scale"], kind) == ("found", (3.0, 2.0, 1.0), "labels")


def test_a_label_image_that_does_not_fit_the_memory_becomes_labels_of_all_levels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, labels = tmp_path / "found.zarr", np.ones((256, 4, 4), np.int32)
    write_labels_zarr(path, labels, (1.0, 1.0, 1.0))
    monkeypatch.setattr("napari_unpack.file_sizes.free_memory", lambda: labels.nbytes)
    ((levels, about, kind),) = read_layers(str(path))
    assert [level.shape for level in levels] == [(256, 4, 4), (128, 2, 2)]
    assert (about["name"], about["multiscale"], kind) == ("found", True, "labels")


def test_several_time_points_of_labels_keep_their_axis(tmp_path: Path) -> None:
    path = tmp_path / "cells.zarr"
    node = zarr.open_group(str(path), mode="w", zarr_format=2)
    stack = np.stack([VOLUME, VOLUME + 1])
    node.create_array("0", shape=stack.shape, dtype=stack.dtype)[...] = stack
    axes = [{"name": "t"}, *({"name": axis, "unit": "millimeter"} for axis in "zyx")]
    steps = [{"type": "scale", "scale": [1.0, 3.0, 2.0, 1.0]}]
    levels = [{"path": "0", "coordinateTransformations": steps}]
    node.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": levels}]
    node.attrs["image-label"] = {"version": "0.4"}
    ((data, about, kind),) = read_layers(str(path))
    np.testing.assert_array_equal(data, stack)
    assert (about["axis_labels"], kind) == (("t", "z", "y", "x"), "labels")


@pytest.mark.parametrize("fits", [True, False])
def test_a_label_image_of_fractions_becomes_an_image(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fits: bool
) -> None:
    # napari has whole numbers alone as labels.
    path, shares = tmp_path / "shares.zarr", np.full((256, 4, 4), 0.5, np.float32)
    write_labels_zarr(path, shares, (1.0, 1.0, 1.0))
    if not fits:
        monkeypatch.setattr("napari_unpack.file_sizes.free_memory", lambda: shares.nbytes)
    ((data, about, kind),) = read_layers(str(path))
    assert kind == "image"
    assert data.dtype == np.float32 if fits else about["multiscale"]


def test_foreign_files_are_left_to_others(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", picture=VOLUME)
    (tmp_path / "photo.png").write_bytes(b"")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "notes.txt").write_text("hello")
    for name in ("other.npz", "photo.png", "folder"):
        assert get_reader(str(tmp_path / name)) is None


def test_a_broken_archive_is_taken_and_explained(tmp_path: Path) -> None:
    path = tmp_path / "broken.npz"
    path.write_bytes(b"no archive")
    reader = get_reader(str(path))
    assert reader is not None
    with pytest.raises(
        ValueError, match=r"broken.npz is damaged, not whole, or not a readable .npz"
    ):
        reader(str(path))


def test_a_folder_of_slices_is_taken(tmp_path: Path) -> None:
    (tmp_path / "IM0001").write_bytes(b"\0" * 128 + b"DICM")
    assert get_reader(str(tmp_path)) is not None


def test_channels_stay_axes_in_front_from_which_the_panel_chooses(tmp_path: Path) -> None:
    import tifffile

    path = tmp_path / "a.tif"
    stack = np.stack([VOLUME, VOLUME + 1], axis=1)
    metadata = {"axes": "ZCYX", "unit": "um", "spacing": 3}
    tifffile.imwrite(path, stack, imagej=True, resolution=(2, 2), metadata=metadata)
    reader = get_reader(str(path))
    assert reader is not None
    ((data, about, kind),) = reader(str(path))
    np.testing.assert_array_equal(data, stack.swapaxes(0, 1))
    assert about["axis_labels"] == ("c", "z", "y", "x")
    assert about["scale"] == pytest.approx((1.0, 3e-3, 5e-4, 5e-4))
    assert about["units"] == ("pixel", "mm", "mm", "mm")
    assert kind == "image"


def test_a_tiff_that_is_dropped_keeps_its_voxel_size(tmp_path: Path, npe2pm: Any) -> None:
    from npe2 import PluginManifest, read

    manifest = Path(napari_unpack.__file__).with_name("napari.yaml")
    npe2pm.register(PluginManifest.from_file(manifest))
    for name in ("bag.tif", "BAG.TIFF"):
        save_scan(Scan(VOLUME, (3.0, 0.5, 0.25)), tmp_path / name)
        # As napari reads a file with the reader that a person has chosen.
        ((data, about, _),) = read([str(tmp_path / name)], stack=False, plugin_name="napari-unpack")
        np.testing.assert_array_equal(data, VOLUME)
        assert about["scale"] == pytest.approx((3.0, 0.5, 0.25))


@pytest.mark.parametrize("slices", [True, False])
def test_pictures_in_tiff_are_left_to_napari_and_stacks_are_not(
    tmp_path: Path, slices: bool
) -> None:
    import tifffile

    colours = np.zeros((4, 5, 3), np.uint8)
    written: list[tuple[object, dict[str, object]]] = [
        (VOLUME if slices else VOLUME[0], {"photometric": "minisblack"}),
        (VOLUME, {"imagej": True, "metadata": {"axes": "ZYX" if slices else "TYX"}}),
        (VOLUME, {"ome": True, "metadata": {"axes": "ZYX" if slices else "CYX"}}),
        (np.stack([colours] * 3) if slices else colours, {"photometric": "rgb"}),
    ]
    for number, (array, settings) in enumerate(written):
        path = tmp_path / f"{number}.tif"
        tifffile.imwrite(path, array, **settings)
        assert (get_reader(str(path)) is not None) == slices, settings


def test_a_stack_of_one_slice_is_a_stack(tmp_path: Path) -> None:
    path = tmp_path / "slice.tif"
    save_scan(Scan(VOLUME[:1], (3.0, 0.5, 0.25)), path)
    reader = get_reader(str(path))
    assert reader is not None
    ((data, about, _),) = reader(str(path))
    np.testing.assert_array_equal(data, VOLUME[:1])
    assert about["scale"] == pytest.approx((3.0, 0.5, 0.25))


def test_a_damaged_tiff_is_taken_and_explained(tmp_path: Path) -> None:
    path = tmp_path / "bag.tif"
    path.write_bytes(b"II*\0 and no more")
    reader = get_reader(str(path))
    assert reader is not None
    with pytest.raises(ValueError, match=r"bag\.tif"):
        reader(str(path))


SUFFIXES = (".npz", ".nrrd", ".nii.gz", ".tif")


def three(folder: Path, suffix: str, **changed: Any) -> list[str]:
    """Save three time points, the last of them with some other facts; return their paths."""
    paths = [folder / f"t{k}{suffix}" for k in range(3)]
    for k, path in enumerate(paths):
        save_scan(Scan(**{"volume": VOLUME + k, "spacing": (3.0, 2.0, 1.0)}), path)
    if changed:
        facts = {"volume": VOLUME, "spacing": (3.0, 2.0, 1.0)} | changed
        save_scan(Scan(**facts), paths[-1])
    return [str(path) for path in paths]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_files_opened_as_a_stack_are_the_time_points_of_one_image(
    tmp_path: Path, suffix: str
) -> None:
    paths = three(tmp_path, suffix)
    reader = get_reader(paths)
    assert reader is not None
    ((data, about, kind),) = reader(paths)
    np.testing.assert_array_equal(data, [VOLUME, VOLUME + 1, VOLUME + 2])
    assert (about["scale"], kind) == ((1.0, 3.0, 2.0, 1.0), "image")
    assert about["axis_labels"] == ("t", "z", "y", "x")


def test_labels_and_names_of_a_stack_are_those_of_all_its_files(tmp_path: Path) -> None:
    paths = [tmp_path / "t0.npz", tmp_path / "t1.npz"]
    for k, path in enumerate(paths):
        labels = (VOLUME > 30).astype(np.uint8) + np.uint8(k)
        save_scan(Scan(VOLUME, (3.0, 2.0, 1.0), labels, names={1 + k: f"Shoe {k}"}), path)
    image, marks = read_layers([str(path) for path in paths])
    assert image[0].shape == marks[0].shape == (2, 3, 4, 5)
    assert marks[1]["scale"] == (1.0, 3.0, 2.0, 1.0)
    assert marks[1]["features"] == {"index": [1, 2], "name": ["Shoe 0", "Shoe 1"]}
    save_scan(Scan(VOLUME, (3.0, 2.0, 1.0), labels, names={1: "Boot"}), paths[1])
    with pytest.raises(ValueError, match=r"t1.npz .* its object 1 is 'Boot', not 'Shoe 0'"):
        read_layers([str(path) for path in paths])


PLACE = np.eye(4)
PLACE[0, 3] = 20.0


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"volume": VOLUME[:2]}, "its volume is 2 x 4 x 5, not 3 x 4 x 5"),
        ({"spacing": (3.0, 2.0, 1.5)}, "its voxel size is 3 x 2 x 1.5 mm, not 3 x 2 x 1 mm"),
        ({"labels": (VOLUME > 30).astype(np.uint8)}, "its label volume is 3 x 4 x 5, not none"),
        ({"scanner_from_scan": PLACE}, "it lies elsewhere in the scanner"),
    ],
)
def test_files_that_differ_in_more_than_voxels_are_not_stacked(
    tmp_path: Path, changed: dict[str, Any], reason: str
) -> None:
    with pytest.raises(ValueError, match=f"^t2.npz cannot be stacked on t0.npz: {reason}$"):
        read_layers(three(tmp_path, ".npz", **changed))


def test_a_stack_that_fills_the_memory_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = three(tmp_path, ".npz")
    monkeypatch.setattr("napari_unpack.file_sizes.free_memory", lambda: 4 * VOLUME.nbytes)
    read_layers(paths[0])
    with pytest.raises(TooLargeError, match=r"the stack of t0.npz holds"):
        read_layers(paths)
    assert read_layers(paths, large=True)[0][0].shape == (3, 3, 4, 5)
