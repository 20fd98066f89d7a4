"""Labels of another file lie on the volume as both files say, or it is told that they do not."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations, product
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from napari_unpack.cli import app
from napari_unpack.geometry.transforms import rotation_about
from napari_unpack.io import load_volume, save_scan
from napari_unpack.io.arrays import write_labels_npz
from napari_unpack.io.file_data import FileData
from napari_unpack.io.labels_on_volume import laid_over, scan_with_label_file

SPACING = (2.0, 0.5, 1.0)
LABELS = np.arange(2 * 3 * 4, dtype=np.uint8).reshape(2, 3, 4)
PLACE = np.eye(4)
PLACE[:3, :3], PLACE[:3, 3] = rotation_about((0.2, 1.0, 0.4), 0.5), (-120.0, 45.5, 300.0)
VOLUME = FileData(LABELS * 100, spacing=SPACING, scanner_from_scan=PLACE)


def turned(order: tuple[int, ...], steps: tuple[int, ...]) -> FileData:
    """Return the labels with other axes, in the same place."""
    last = np.where(np.array(steps) < 0, np.array(LABELS.shape) - 1, 0) * SPACING
    place = PLACE.copy()
    place[:3, :3] = (PLACE[:3, :3] * steps)[:, order]
    place[:3, 3] += PLACE[:3, :3] @ last
    array = LABELS[tuple(slice(None, None, step) for step in steps)].transpose(order)
    z, y, x = (SPACING[k] for k in order)
    # As NIfTI keeps it.
    return FileData(None, "zyx", (z, y, x), array, (), place.astype(np.float32).astype(float))


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_labels_with_axes_in_another_order_or_direction_are_turned_back(
    order: tuple[int, ...],
) -> None:
    for steps in product((1, -1), repeat=3):
        found, told = laid_over(turned(order, steps), VOLUME)
        np.testing.assert_array_equal(found, LABELS)
        assert told == ""


def test_labels_that_lie_elsewhere_stay_as_they_are_and_that_is_told() -> None:
    mirrored = turned((0, 1, 2), (-1, 1, 1))
    moved = np.eye(4)
    moved[:3, 3] = PLACE[:3, 0] * 1.2
    for place, word in ((moved @ PLACE, "lie elsewhere"), (np.eye(4), "lie elsewhere")):
        labels = replace(mirrored, scanner_from_scan=place)
        found, told = laid_over(labels, VOLUME)
        assert found is labels.labels
        assert told.startswith(word)
    found, told = laid_over(replace(mirrored, spacing=(2.0, 1.0, 1.0)), VOLUME)
    assert found is mirrored.labels
    assert "voxels of 2 x 1 x 1 mm and not of 2 x 0.5 x 1 mm" in told
    # Where one of the files does not say it, nothing is known.
    unplaced = replace(mirrored, scanner_from_scan=None)
    assert laid_over(unplaced, VOLUME) == (unplaced.labels, "")


def test_labels_that_itk_saved_along_its_axes_lie_on_their_objects(tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    image = sitk.GetImageFromArray(LABELS)
    image.SetSpacing(SPACING[::-1])
    image.SetOrigin((10, 20, 30))
    # Directions of the identity, which are not turned as others are.
    plain = tmp_path / "labels.nrrd"
    sitk.WriteImage(image, str(plain))
    volume = sitk.DICOMOrient(image, "LPI")
    sitk.WriteImage(volume, str(tmp_path / "scan.nii.gz"))
    scan = load_volume(tmp_path / "scan.nii.gz")
    found = scan_with_label_file(scan, plain)
    np.testing.assert_array_equal(found.labels, scan.volume)
    assert found.assumed == scan.assumed
    truth = save_scan(scan.with_labels(scan.volume), tmp_path / "truth.npz")[0]
    score = CliRunner().invoke(app, ["score", str(truth), str(plain)])
    assert "f1                    1.0000" in score.output
    image.SetOrigin((0, 0, 0))
    sitk.WriteImage(image, str(plain))
    (told,) = scan_with_label_file(scan, plain).assumed
    assert told.startswith("its labels (labels.nrrd) lie elsewhere in the scanner")
    score = CliRunner().invoke(app, ["score", str(truth), str(plain)])
    assert "note: labels.nrrd: its labels lie elsewhere" in score.output


def test_labels_that_do_not_say_how_they_lie_are_doubted_on_a_turned_volume(tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    image = sitk.GetImageFromArray(LABELS)
    image.SetSpacing(SPACING[::-1])
    np.save(tmp_path / "bare.npy", LABELS)
    for directions, doubted in (("LPI", False), ("RAS", True), ("PIL", True)):
        path = tmp_path / f"{directions}.nii.gz"
        sitk.WriteImage(sitk.DICOMOrient(image, directions), str(path))
        scan = load_volume(path)
        assert scan.turned == doubted
        told = scan_with_label_file(scan, tmp_path / "bare.npy").assumed[len(scan.assumed) :]
        wanted = (
            "its labels (bare.npy) do not say how they lie (.nrrd, .nii.gz and .mha would), and"
        )
        assert [words.startswith(wanted) for words in told] == [True] * doubted
        # The other way round.
        bare = load_volume(tmp_path / "bare.npy")
        told = scan_with_label_file(bare, path).assumed[len(bare.assumed) :]
        assert any("its volume does not say how it lies" in words for words in told) == doubted
        # What this package saves lies as it says.
        saved = save_scan(scan.with_labels(scan.volume), tmp_path / "saved.npz")[0]
        assert scan_with_label_file(scan, saved).assumed == scan.assumed
        write_labels_npz(saved, scan.volume, scan.spacing, scan.scanner_from_scan)
        assert scan_with_label_file(scan, saved).assumed == scan.assumed
    order = CliRunner().invoke(app, ["order", str(path), "--labels", str(tmp_path / "bare.npy")])
    assert "note: PIL.nii.gz: its labels (bare.npy) do not say how they lie" in order.output
