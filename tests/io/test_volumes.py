"""Every format comes back as it went out; what is broken or foreign is named."""

import gzip
import re
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from napari_unpack.io import Scan, load_labels, load_volume, save_scan
from napari_unpack.io.file_data import NO_UNIT, NO_VOXEL_SIZE

SPACING = (2.5, 0.5, 0.75)
VOLUME = np.arange(4 * 5 * 6, dtype=np.uint16).reshape(4, 5, 6) * 100
LABELS = (VOLUME // 3000).astype(np.uint8)


def scan(labels: np.ndarray | None = LABELS) -> Scan:
    return Scan(VOLUME, SPACING, labels, "bag")


def test_npz_holds_all_of_a_scan(tmp_path: Path) -> None:
    path = tmp_path / "bag.npz"
    assert save_scan(scan(), path) == [path]
    back = load_volume(path)
    np.testing.assert_array_equal(back.volume, VOLUME)
    np.testing.assert_array_equal(back.labels, LABELS)
    assert back.volume.dtype == np.uint16
    assert back.spacing == SPACING
    assert back.name == "bag"


def test_npz_holds_what_had_to_be_assumed_of_the_file_it_came_from(tmp_path: Path) -> None:
    np.save(tmp_path / "bare.npy", VOLUME)
    bare = load_volume(tmp_path / "bare.npy")
    assert bare.assumed == ("it gives no voxel size: 1 mm was assumed",)
    save_scan(bare.with_labels(LABELS), tmp_path / "found.npz")
    assert load_volume(tmp_path / "found.npz").assumed == bare.assumed
    # Another program's array of that name is no sentence.
    np.savez(tmp_path / "odd.npz", volume=VOLUME, spacing=SPACING, assumed=np.ones(3))
    assert load_volume(tmp_path / "odd.npz").assumed == ()


def test_npz_holds_what_objects_are_called(tmp_path: Path) -> None:
    path = tmp_path / "bag.npz"
    named = Scan(VOLUME, SPACING, LABELS, names={3: "Shoe", 1: "Mug"})
    save_scan(named, path)
    assert load_volume(path).names == {1: "Mug", 3: "Shoe"}
    assert load_volume(path).with_labels(LABELS).names is None
    save_scan(scan(), path)
    assert load_volume(path).names is None


def test_npz_holds_names_of_large_ids_without_a_row_for_every_id(tmp_path: Path) -> None:
    path = tmp_path / "bag.npz"
    names = {2**62: "Shoe", 1: "Mug"}
    save_scan(Scan(VOLUME, SPACING, LABELS, names=names), path)
    assert load_volume(path).names == names
    with np.load(path) as arrays:
        # Versions that know only these would give them to IDs 0 and 1.
        assert "names" not in arrays
    # As every version reads them: a place for each ID.
    save_scan(Scan(VOLUME, SPACING, LABELS, names={3: "Shoe", 1: "Mug"}), path)
    with np.load(path) as arrays:
        assert arrays["names"].tolist() == ["", "Mug", "", "Shoe"]
        assert set(arrays) == {"volume", "spacing", "labels", "names"}


@pytest.mark.parametrize("ids", [np.arange(3), np.array([1.5, 2]), np.array([[1, 2]])])
def test_names_with_ids_that_are_none_of_theirs_are_left_out(
    tmp_path: Path, ids: np.ndarray
) -> None:
    path = tmp_path / "odd.npz"
    np.savez(path, volume=VOLUME, labels=LABELS, names_of_ids=["Mug", "Shoe"], named_ids=ids)
    assert load_volume(path).names is None


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz", ".mha", ".nrrd", ".tif"])
def test_other_formats_hold_the_volume_and_labels_beside_it(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"bag{suffix}"
    written = save_scan(scan(), path)
    assert [p.name for p in written] == [f"bag{suffix}", f"bag.labels{suffix}"]
    assert sorted(tmp_path.iterdir()) == sorted(written), "nothing else is left behind"
    back = load_volume(path)
    np.testing.assert_array_equal(back.volume, VOLUME)
    assert back.volume.dtype == np.uint16
    assert back.spacing == pytest.approx(SPACING)
    assert back.labels is None
    assert back.name == "bag"
    labels, spacing = load_labels(written[1])
    np.testing.assert_array_equal(labels, LABELS)
    assert spacing == pytest.approx(SPACING)


@pytest.mark.parametrize("suffix", [".npz", ".nii.gz", ".mha", ".nrrd", ".tif"])
def test_a_mask_is_a_volume_of_0_and_1(tmp_path: Path, suffix: str) -> None:
    mask = VOLUME > 3000
    path = tmp_path / f"a{suffix}"
    save_scan(Scan(mask, SPACING), path)
    np.testing.assert_array_equal(load_volume(path).volume, mask.astype(np.uint8), strict=True)


def test_a_mask_that_another_program_wrote_is_read_without_a_copy(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", VOLUME > 3000)
    found = load_volume(tmp_path / "a.npy").volume
    np.testing.assert_array_equal(found, (VOLUME > 3000).astype(np.uint8), strict=True)
    assert found.base is not None


def test_a_bare_array(tmp_path: Path) -> None:
    np.save(tmp_path / "bag.npy", VOLUME.astype(np.float32)[None])
    back = load_volume(tmp_path / "bag.npy")
    np.testing.assert_array_equal(back.volume, VOLUME)
    assert back.spacing == (1.0, 1.0, 1.0)


def test_a_turned_nifti_is_put_upright(tmp_path: Path) -> None:
    sitk = pytest.importorskip("SimpleITK")
    # Stored with x to the right and y to the front, as NIfTI likes: both are turned round, and
    # z, to the head, too.
    image = sitk.GetImageFromArray(VOLUME)
    image.SetSpacing(SPACING[::-1])
    image.SetDirection((-1, 0, 0, 0, -1, 0, 0, 0, 1))
    sitk.WriteImage(image, str(tmp_path / "bag.nii.gz"))
    back = load_volume(tmp_path / "bag.nii.gz")
    np.testing.assert_array_equal(back.volume, VOLUME[::-1, ::-1, ::-1])
    assert back.spacing == pytest.approx(SPACING)


def test_ome_tiff_knows_its_voxel_size(tmp_path: Path) -> None:
    import tifffile

    tifffile.imwrite(
        tmp_path / "bag.ome.tif",
        VOLUME,
        metadata={
            "axes": "ZYX",
            "PhysicalSizeX": 750.0,
            "PhysicalSizeY": 500.0,
            "PhysicalSizeZ": 2.5,
            "PhysicalSizeZUnit": "mm",
        },
    )
    back = load_volume(tmp_path / "bag.ome.tif")
    np.testing.assert_array_equal(back.volume, VOLUME)
    assert back.spacing == pytest.approx(SPACING)


@pytest.mark.parametrize("version", ["0.4", "0.5"])
def test_ome_zarr_with_labels(tmp_path: Path, version: str) -> None:
    zarr = pytest.importorskip("zarr")
    root = zarr.open_group(
        str(tmp_path / "bag.zarr"), mode="w", zarr_format=2 if version == "0.4" else 3
    )
    axes = [{"name": "c", "type": "channel"}] + [
        {"name": n, "type": "space", "unit": "micrometer"} for n in "zyx"
    ]

    def describe(group: Any, array: np.ndarray, axes: list[dict[str, str]]) -> None:
        group.create_array("0", data=array)
        scale = [1.0] * (array.ndim - 3) + [2500.0, 500.0, 750.0]
        entry = {
            "axes": axes,
            "datasets": [
                {"path": "0", "coordinateTransformations": [{"type": "scale", "scale": scale}]}
            ],
        }
        about = {"multiscales": [entry], "version": version}
        group.attrs.update({"ome": about} if version == "0.5" else about)

    describe(root, VOLUME[None], axes)
    labels = root.create_group("labels")
    labels.attrs.update(
        {"ome": {"labels": ["objects"]}} if version == "0.5" else {"labels": ["objects"]}
    )
    describe(labels.create_group("objects"), LABELS, axes[1:])
    back = load_volume(tmp_path / "bag.zarr")
    np.testing.assert_array_equal(back.volume, VOLUME)
    np.testing.assert_array_equal(back.labels, LABELS)
    assert back.spacing == pytest.approx(SPACING)


def save_zarr(path: Path, array: np.ndarray, axes: str, **given: str | None) -> None:
    zarr = pytest.importorskip("zarr")
    root = zarr.open_group(str(path), mode="w", zarr_format=2)
    root.create_array("0", data=array)
    scale = [{"z": 3.0, "y": 2.0, "x": 1.0}.get(axis, 1.0) for axis in axes]
    steps = [{"type": "scale", "scale": scale}]
    units = {**dict.fromkeys("zyx", "millimeter"), **given}
    root.attrs["multiscales"] = [
        {
            "axes": [{"name": a} | ({"unit": units[a]} if units.get(a) else {}) for a in axes],
            "datasets": [{"path": "0", "coordinateTransformations": steps}],
        }
    ]


@pytest.mark.parametrize("axes", ["zyxc", "tczyx", "xyz", "cxzy"])
def test_axes_of_ome_zarr_go_by_their_names(tmp_path: Path, axes: str) -> None:
    lengths = {"t": 2, "c": 3} | dict(zip("zyx", VOLUME.shape, strict=True))
    others = [a for a in axes if a not in "zyx"]
    whole = VOLUME.reshape([*VOLUME.shape] + [1] * len(others)) + np.zeros(
        [*VOLUME.shape] + [lengths[a] for a in others], np.uint16
    )
    # The last element of each other axis is the volume; the rest are something else.
    for k, a in enumerate(others):
        whole[(slice(None),) * (3 + k) + (slice(0, lengths[a] - 1),)] = 7
    order = ["zyx".index(a) if a in "zyx" else 3 + others.index(a) for a in axes]
    save_zarr(tmp_path / "a.zarr", whole.transpose(order), axes)
    if others:
        with pytest.raises(ValueError, match=r"a.zarr holds \d (channel|time point)s .* such as"):
            load_volume(tmp_path / "a.zarr")
    found = load_volume(tmp_path / "a.zarr", {a: lengths[a] - 1 for a in others})
    np.testing.assert_array_equal(found.volume, VOLUME)
    assert found.spacing == (3.0, 2.0, 1.0)
    with pytest.raises(ValueError, match="has no axis w to choose from"):
        load_volume(tmp_path / "a.zarr", dict.fromkeys([*others, "w"], 0))


@pytest.mark.parametrize("axes", ["cyx", "tyx"])
def test_a_channel_or_a_time_is_never_taken_for_z(tmp_path: Path, axes: str) -> None:
    save_zarr(tmp_path / "a.zarr", VOLUME, axes)
    with pytest.raises(
        ValueError, match=rf"must hold a volume with axes z, y, x, got axes {axes[0]}"
    ):
        load_volume(tmp_path / "a.zarr")


def test_units_are_known_or_told(tmp_path: Path) -> None:
    save_zarr(tmp_path / "b.zarr", VOLUME, "zyx", z="Angstrom", y="nanometer", x="angstrom")
    found = load_volume(tmp_path / "b.zarr")
    assert (found.spacing, found.assumed) == (pytest.approx((3e-7, 2e-6, 1e-7)), ())
    save_zarr(tmp_path / "a.zarr", VOLUME, "zyx", z="millimeter", y="inch", x="parsec")
    found = load_volume(tmp_path / "a.zarr")
    assert found.spacing == pytest.approx((3.0, 50.8, 1.0))
    assert found.assumed == ("its unit of length 'parsec' is not known: mm was assumed",)
    save_zarr(tmp_path / "d.zarr", VOLUME, "zyx", z="Micrometers", y="Micron", x="micrometers")
    found = load_volume(tmp_path / "d.zarr")
    assert (found.spacing, found.assumed) == (pytest.approx((3e-3, 2e-3, 1e-3)), ())
    save_zarr(tmp_path / "c.zarr", VOLUME, "zyx", x=None)
    assert load_volume(tmp_path / "c.zarr").assumed == (NO_UNIT,)


def save_nrrd(path: Path, *fields: str, array: np.ndarray = VOLUME) -> None:
    sizes = " ".join(map(str, array.shape[::-1]))
    head = ["NRRD0005", "type: uint16", f"dimension: {array.ndim}", f"sizes: {sizes}"]
    lines = [*head, "encoding: raw", "endian: little", *fields, "", ""]
    path.write_bytes("\n".join(lines).encode() + array.astype("<u2").tobytes())


def test_units_of_nrrd_are_known_or_told(tmp_path: Path) -> None:
    path = tmp_path / "a.nrrd"
    along = ["space dimension: 3", "space directions: (750,0,0) (0,500,0) (0,0,2500)"]
    save_nrrd(path, *along, "space origin: (1000,0,0)", 'space units: "um" "um" "um"')
    found = load_volume(path)
    assert found.spacing == pytest.approx(SPACING)
    assert found.scanner_from_scan is not None
    np.testing.assert_allclose(found.scanner_from_scan[:3, 3], [1, 0, 0])
    save_nrrd(path, "spacings: 0.75 0.5 2.5", 'units: "furlong" "furlong" "furlong"')
    found = load_volume(path)
    assert found.spacing == pytest.approx(SPACING)
    assert found.assumed == ("its unit of length 'furlong' is not known: mm was assumed",)
    # Two signs that differ by their capital alone: the other is a megametre.
    for unit, told in (
        ("MM", ()),
        ("Mm", ("its unit of length 'Mm' is not known: mm was assumed",)),
    ):
        save_nrrd(path, "spacings: 0.75 0.5 2.5", f'units: "{unit}" "{unit}" "{unit}"')
        assert load_volume(path).assumed == told
    save_nrrd(path, "spacings: 0.75 0.5 2.5", 'units: "mm" "mm" "cm"')
    with pytest.raises(ValueError, match="must have one unit of length, got cm, mm"):
        load_volume(path)
    save_nrrd(path, "spacings: 0.75 0.5 2.5", 'units: "mm" "mm" "furlong"')
    with pytest.raises(ValueError, match="must have one unit of length, got furlong, mm"):
        load_volume(path)


@pytest.mark.parametrize(
    ("array", "fields"),
    [
        (VOLUME[None], ["spacings: 0.75 0.5 2.5 nan", 'units: "mm" "mm" "mm" "s"']),
        (VOLUME[..., None], ["kinds: list domain domain domain", "spacings: nan 0.75 0.5 2.5"]),
        (VOLUME[None], ["kinds: domain domain domain stub", "spacings: 0.75 0.5 2.5 nan"]),
        (VOLUME, ["spacings: 0.75 0.5 2.5", 'units: "mm" "mm" "millimeter"']),
        (VOLUME, ["kinds: ??? ??? ???", "spacings: 0.75 0.5 2.5", 'units: "mm" "mm" "mm"']),
        (
            VOLUME[None],
            [
                "space: left-posterior-superior-time",
                "space directions: (0.75,0,0,0) (0,0.5,0,0) (0,0,2.5,0) (0,0,0,1)",
                'space units: "mm" "mm" "mm" "s"',
            ],
        ),
    ],
)
def test_only_the_axes_of_space_of_nrrd_are_asked_for_lengths(
    tmp_path: Path, array: np.ndarray, fields: list[str]
) -> None:
    path = tmp_path / "a.nrrd"
    save_nrrd(path, *fields, array=array)
    found = load_volume(path)
    np.testing.assert_array_equal(found.volume, VOLUME)
    assert found.spacing == pytest.approx(SPACING)
    assert found.assumed == ()


def test_a_time_axis_of_nrrd_is_never_taken_for_z(tmp_path: Path) -> None:
    save_nrrd(tmp_path / "a.nrrd", "kinds: domain domain time")
    with pytest.raises(ValueError, match=r"must hold a volume with axes z, y, x, got axes t"):
        load_volume(tmp_path / "a.nrrd")


@pytest.mark.parametrize(
    ("array", "kinds", "spacings"),
    [
        (VOLUME[None], "domain domain domain time", "0.75 0.5 2.5 1"),
        (VOLUME[:1, ..., None], "time domain domain domain", "1 0.75 0.5 2.5"),
    ],
)
def test_a_time_axis_of_nrrd_may_be_of_one_time_point(
    tmp_path: Path, array: np.ndarray, kinds: str, spacings: str
) -> None:
    path = tmp_path / "a.nrrd"
    save_nrrd(path, f"kinds: {kinds}", f"spacings: {spacings}", array=array)
    found = load_volume(path)
    np.testing.assert_array_equal(found.volume, VOLUME[: array.size // VOLUME[0].size])
    assert found.spacing == pytest.approx(SPACING)


def test_what_a_header_does_not_say_of_voxels_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.nrrd"
    save_nrrd(path)
    assert load_volume(path).assumed == (NO_VOXEL_SIZE,)
    save_nrrd(path, "spacings: 0.75 nan 2.5")
    assert load_volume(path).spacing == (2.5, 1.0, 0.75)
    assert load_volume(path).assumed == ("its voxel size holds nan: 1 mm was assumed there",)
    save_nrrd(
        path,
        "space: left-posterior-superior",
        "space directions: (0.75,0.25,0) (0,0.5,0) (0,0,2.5)",
    )
    found = load_volume(path)
    assert found.assumed == ("its axes are not at right angles: it is shown as if they were",)
    assert found.scanner_from_scan is None
    path = tmp_path / "a.mha"
    save_scan(Scan(VOLUME, SPACING), path)
    assert load_volume(path).assumed == ()
    path.write_bytes(re.sub(rb"ElementSpacing[^\n]*\n", b"", path.read_bytes()))
    assert load_volume(path).assumed == (NO_VOXEL_SIZE,)


@pytest.mark.parametrize(("code", "said"), [(0, NO_UNIT), (7, "its unit of length (7)")])
def test_a_unit_of_nifti_that_is_none_is_told(tmp_path: Path, code: int, said: str) -> None:
    path = tmp_path / "a.nii"
    save_scan(Scan(VOLUME, SPACING), path)
    assert load_volume(path).assumed == ()
    # By the standard xyzt_units is byte 123.
    head = bytearray(path.read_bytes())
    head[123] = code
    path.write_bytes(head)
    assert load_volume(path).assumed[0].startswith(said)


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
def test_a_nifti_file_that_rescales_its_voxels_is_not_taken_for_a_short_one(
    tmp_path: Path, suffix: str
) -> None:
    save_scan(Scan(VOLUME, SPACING), tmp_path / "a.nii")
    # By the standard scl_slope and scl_inter begin at byte 112. As float they take twice as much.
    head = bytearray((tmp_path / "a.nii").read_bytes())
    struct.pack_into("<2f", head, 112, 2, -1000)
    path = tmp_path / f"b{suffix}"
    path.write_bytes(gzip.compress(head) if suffix.endswith(".gz") else head)
    np.testing.assert_array_equal(load_volume(path).volume, VOLUME * 2.0 - 1000)


def test_channels_and_colours_of_tiff_are_offered(tmp_path: Path) -> None:
    import tifffile

    path = tmp_path / "a.tif"
    stack = np.stack([VOLUME, VOLUME + 1], axis=1)
    tifffile.imwrite(path, stack, imagej=True, metadata={"axes": "ZCYX"})
    with pytest.raises(ValueError, match=r"holds 2 channels"):
        load_volume(path)
    np.testing.assert_array_equal(load_volume(path, {"c": 1}).volume, VOLUME + 1)
    colours = np.stack([VOLUME, VOLUME, VOLUME // 2], axis=-1).astype(np.uint8)
    tifffile.imwrite(path, colours, photometric="rgb")
    np.testing.assert_array_equal(load_volume(path, {"c": 2}).volume, colours[..., 2])
    tifffile.imwrite(path, VOLUME, imagej=True, metadata={"axes": "TYX"})
    with pytest.raises(ValueError, match="must hold a volume with axes z, y, x"):
        load_volume(path)


def test_the_voxel_size_of_tiff_tags_is_taken_where_it_was_measured(tmp_path: Path) -> None:
    import tifffile

    path = tmp_path / "a.tif"
    tifffile.imwrite(
        path, VOLUME, resolution=(100, 50), resolutionunit="CENTIMETER", photometric="minisblack"
    )
    found = load_volume(path)
    assert found.spacing == pytest.approx((0.2, 0.2, 0.1))
    assert found.assumed == ("it gives no distance of slices: that of its rows was assumed",)
    ome = {"axes": "ZYX", "PhysicalSizeX": 750, "PhysicalSizeY": 500}
    tifffile.imwrite(tmp_path / "a.ome.tif", VOLUME, metadata=ome)
    found = load_volume(tmp_path / "a.ome.tif")
    assert found.spacing == pytest.approx((0.5, 0.5, 0.75))
    assert found.assumed == ("it gives no distance of slices: that of its rows was assumed",)
    tifffile.imwrite(
        tmp_path / "b.ome.tif",
        VOLUME,
        metadata={"axes": "ZYX", "PhysicalSizeX": 2, "PhysicalSizeXUnit": "pixel"},
    )
    # Nothing is said of a size that is not used.
    assert load_volume(tmp_path / "b.ome.tif").assumed == (NO_VOXEL_SIZE,)
    notes = {"axes": "ZYX", "unit": "micron", "zunit": "mm", "spacing": 2.5}
    tifffile.imwrite(path, VOLUME, imagej=True, metadata=notes, resolution=(1 / 750, 1 / 500))
    assert load_volume(path).spacing == pytest.approx(SPACING)
    # As ImageJ writes the micro sign: in six characters.
    notes |= {"unit": r"\u00B5m", "zunit": r"\u00b5m", "spacing": 2500}
    tifffile.imwrite(path, VOLUME, imagej=True, metadata=notes, resolution=(1 / 750, 1 / 500))
    assert load_volume(path).spacing == pytest.approx(SPACING)
    assert load_volume(path).assumed == ()
    # Of a stack that was turned over.
    notes |= {"spacing": -2500}
    tifffile.imwrite(path, VOLUME, imagej=True, metadata=notes, resolution=(1 / 750, 1 / 500))
    assert load_volume(path).spacing == pytest.approx(SPACING)
    tifffile.imwrite(
        path, VOLUME, resolution=(72, 72), resolutionunit="INCH", photometric="minisblack"
    )
    assert load_volume(path).spacing == (1.0, 1.0, 1.0)
    assert load_volume(path).assumed == ("it gives no voxel size: 1 mm was assumed",)


@pytest.mark.parametrize("shape", [(1, 40, 50), (3, 1, 1), (3, 40, 1), (1, 40, 1), (1, 1, 1)])
def test_a_tiff_holds_volumes_of_one_slice_or_one_column(
    tmp_path: Path, shape: tuple[int, int, int]
) -> None:
    volume = np.arange(np.prod(shape), dtype=np.uint16).reshape(shape)
    save_scan(Scan(volume, SPACING), tmp_path / "thin.tif")
    back = load_volume(tmp_path / "thin.tif")
    np.testing.assert_array_equal(back.volume, volume, strict=True)
    assert back.spacing == pytest.approx(SPACING)


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
def test_a_nifti_file_that_ends_early_is_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    save_scan(Scan(VOLUME, SPACING), path)
    packed = path.read_bytes()
    whole = gzip.decompress(packed) if suffix.endswith(".gz") else packed
    assert len(whole) == 352 + VOLUME.nbytes
    short = gzip.compress(whole[:-1]) if suffix.endswith(".gz") else whole[:-1]
    for cut in (short, packed[: -len(packed) // 4]):
        path.write_bytes(cut)
        with pytest.raises(ValueError, match=r"is not whole: its header asks for [\d,]+ bytes"):
            load_volume(path)


# As outside a scanner's round field of view; the first and the last slice are looked at on saving.
HOLES = VOLUME.astype(np.float32) - 1000
HOLES[0, 0, :2] = np.nan
HOLES[1, 2, 3], HOLES[-1, -1, -1] = np.inf, -np.inf


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz", ".mha", ".nrrd", ".tif", ".npz"])
def test_what_is_not_finite_is_written_and_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    for volume in (HOLES, HOLES.astype(np.float64))[: 1 if suffix == ".tif" else 2]:
        save_scan(Scan(volume, SPACING), path)
        np.testing.assert_array_equal(load_volume(path).volume, volume, strict=True)


@pytest.mark.parametrize("slope", [2.0, -2.0])
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
def test_what_is_not_finite_in_a_nifti_file_is_none_after_rescaling_and_turning(
    tmp_path: Path, suffix: str, order: str, slope: float
) -> None:
    head = bytearray(352)
    # By the standard: sizes at byte 40, the type and its bits at 70, voxel sizes at 76, where the
    # voxels begin, slope and offset at 108, the turn's code at 252, its rows at 280.
    struct.pack_into(f"{order}i", head, 0, 348)
    struct.pack_into(f"{order}8h", head, 40, 4, *HOLES.shape[::-1], 2, 1, 1, 1)
    struct.pack_into(f"{order}2h", head, 70, 16, 32)
    struct.pack_into(f"{order}8f", head, 76, 1, *SPACING[::-1], 1, 1, 1, 1)
    struct.pack_into(f"{order}3f", head, 108, 352, slope, -5)
    struct.pack_into(f"{order}2h", head, 252, 0, 1)
    rows = np.diag([SPACING[2], SPACING[1], SPACING[0], 1])[:3]
    struct.pack_into(f"{order}12f", head, 280, *rows.ravel())
    head[344:348] = b"n+1\0"
    stored = np.stack([HOLES[:, ::-1], HOLES]).astype(f"{order}f4").tobytes()
    path = tmp_path / f"a{suffix}"
    packed = gzip.compress if suffix.endswith(".gz") else bytes
    path.write_bytes(packed(bytes(head) + stored))
    for t, wanted in enumerate((HOLES[:, ::-1], HOLES)):
        found = load_volume(path, {"t": t}).volume
        np.testing.assert_array_equal(found, wanted * slope - 5)
    # One time point alone is turned upright.
    struct.pack_into(f"{order}h", head, 40, 3)
    path.write_bytes(packed(bytes(head) + stored))
    np.testing.assert_array_equal(load_volume(path).volume, HOLES[::-1, :, ::-1] * slope - 5)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("suffix", [".nii", ".nii.gz"])
def test_nifti_2_is_refused_by_its_name(tmp_path: Path, suffix: str, order: str) -> None:
    path = tmp_path / f"a{suffix}"
    head = struct.pack(f"{order}i8s", 540, b"n+2\0\r\n\x1a\n").ljust(544, b"\0")
    path.write_bytes(gzip.compress(head) if suffix.endswith(".gz") else head)
    with pytest.raises(ValueError, match=r"is NIfTI-2, which is not read: save it as NIfTI-1"):
        load_volume(path)


@pytest.mark.parametrize("size", [0.0, np.nan])
def test_a_voxel_size_of_nifti_that_is_none_is_told(tmp_path: Path, size: float) -> None:
    path = tmp_path / "a.nii"
    save_scan(Scan(VOLUME, SPACING), path)
    # By the standard pixdim begins at byte 76; its fourth number is the size along z.
    head = bytearray(path.read_bytes())
    struct.pack_into("<f", head, 76 + 12, size)
    path.write_bytes(head)
    found = load_volume(path)
    assert found.spacing[0] == 1.0
    assert found.assumed == (f"its voxel size holds {size:g}: 1 mm was assumed there",)


def test_labels_alone(tmp_path: Path) -> None:
    np.savez(tmp_path / "l.npz", labels=LABELS, spacing=SPACING)
    labels, spacing = load_labels(tmp_path / "l.npz")
    np.testing.assert_array_equal(labels, LABELS)
    assert spacing == SPACING
    with pytest.raises(ValueError, match="labels without a volume"):
        load_volume(tmp_path / "l.npz")


def test_densities_that_a_file_calls_so_are_not_taken_for_labels(tmp_path: Path) -> None:
    save_scan(scan(None), tmp_path / "v.npz")
    save_zarr(tmp_path / "bag.zarr", VOLUME, "zyx")
    save_zarr(tmp_path / "bag.zarr" / "labels" / "cells", LABELS[::2, ::2, ::2], "zyx")
    pytest.importorskip("zarr").open_group(tmp_path / "bag.zarr" / "labels", zarr_format=2)
    for name in ("v.npz", "bag.zarr"):
        with pytest.raises(ValueError, match=rf"{name} holds a volume without labels that fit it"):
            load_labels(tmp_path / name)
    found = load_volume(tmp_path / "bag.zarr")
    np.testing.assert_array_equal(found.volume, VOLUME)
    said = "its labels have another shape than its volume: they were left out"
    assert (found.labels, found.assumed) == (None, (said,))
    # A bare array may be either, and many programs write labels as an image without a mark.
    np.save(tmp_path / "l.npy", LABELS)
    save_zarr(tmp_path / "l.zarr", LABELS, "zyx")
    for name in ("l.npy", "l.zarr"):
        np.testing.assert_array_equal(load_labels(tmp_path / name)[0], LABELS)


def test_labels_must_be_whole_numbers_and_fit(tmp_path: Path) -> None:
    np.save(tmp_path / "l.npy", LABELS.astype(np.float32))
    assert load_labels(tmp_path / "l.npy")[0].dtype.kind == "i"
    np.save(tmp_path / "l.npy", LABELS + 0.5)
    with pytest.raises(ValueError, match="must hold object IDs"):
        load_labels(tmp_path / "l.npy")
    np.save(tmp_path / "l.npy", LABELS.astype(np.int16) - 1)
    with pytest.raises(ValueError, match="negative"):
        load_labels(tmp_path / "l.npy")
    assert scan(None).with_labels(LABELS.astype(np.float32)).labels.dtype.kind == "i"
    with pytest.raises(ValueError, match="volume's shape"):
        scan(None).with_labels(LABELS[1:])


@pytest.mark.parametrize(
    "name", ["a.npz", "a.npy", "a.nii", "a.nii.gz", "a.mha", "a.nrrd", "a.tif", "a.dcm"]
)
def test_a_broken_file_is_named(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"this is no volume at all, whatever its name may say")
    with pytest.raises(ValueError, match=re.escape(name)):
        load_volume(path)
    path.write_bytes(b"")
    with pytest.raises(ValueError, match="is empty"):
        load_volume(path)


def test_a_cut_off_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "bag.npz"
    save_scan(scan(), path)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(ValueError, match=r"bag.npz is damaged, not whole, or not a readable .npz"):
        load_volume(path)


def test_missing_unknown_and_flat_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"no such file: .*nowhere.npz"):
        load_volume(tmp_path / "nowhere.npz")
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(ValueError, match=r"no known format; can read .npz"):
        load_volume(tmp_path / "notes.txt")
    np.save(tmp_path / "flat.npy", VOLUME[0])
    with pytest.raises(ValueError, match=r"3D volume .* shape \(5, 6\)"):
        load_volume(tmp_path / "flat.npy")
    np.save(tmp_path / "words.npy", np.full((2, 2, 2), "a"))
    with pytest.raises(ValueError, match="real numbers"):
        load_volume(tmp_path / "words.npy")
    (tmp_path / "folder").mkdir()
    with pytest.raises(ValueError, match="holds no DICOM images"):
        load_volume(tmp_path / "folder")
    (tmp_path / "bag.zarr").mkdir()
    with pytest.raises(ValueError, match="not a readable Zarr"):
        load_volume(tmp_path / "bag.zarr")
    np.savez(tmp_path / "odd.npz", image=VOLUME)
    with pytest.raises(ValueError, match=r"'volume' or 'labels', got \['image'\]"):
        load_volume(tmp_path / "odd.npz")
    np.savez(tmp_path / "odd.npz", volume=VOLUME, spacing=[1, 0, 1])
    with pytest.raises(ValueError, match="three positive numbers of mm"):
        load_volume(tmp_path / "odd.npz")
    np.savez(tmp_path / "odd.npz", volume=VOLUME, labels=LABELS[1:])
    with pytest.raises(ValueError, match="must have one shape"):
        load_volume(tmp_path / "odd.npz")


def test_a_missing_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "SimpleITK", None)
    for name in ("bag.mha", "bag.nii.gz"):
        suffix = re.escape(name.removeprefix("bag"))
        (tmp_path / name).write_bytes(b"anything")
        told = rf"^reading {suffix} files needs SimpleITK, .* pip install SimpleITK"
        with pytest.raises(ImportError, match=told):
            load_volume(tmp_path / name)
        with pytest.raises(ImportError, match=rf"^writing {suffix} files needs SimpleITK"):
            save_scan(scan(), tmp_path / name)


@pytest.mark.parametrize("dtype", [np.int32, np.int64, np.int16, np.float64])
@pytest.mark.parametrize("suffix", [".npz", ".nii.gz", ".mha", ".nrrd", ".tif"])
def test_labels_of_any_type_are_written_as_narrow_ones(
    tmp_path: Path, suffix: str, dtype: type
) -> None:
    *_, last = save_scan(scan(LABELS.astype(dtype)), tmp_path / f"bag{suffix}")
    np.testing.assert_array_equal(load_labels(last)[0], LABELS.astype(np.uint16), strict=True)


def test_a_volume_whose_labels_cannot_be_written_is_not_replaced(tmp_path: Path) -> None:
    save_scan(scan(), tmp_path / "bag.tif")
    before = {file: file.read_bytes() for file in tmp_path.iterdir()}
    large = LABELS.astype(np.int64) * 2**17
    with pytest.raises(ValueError, match="uint8, uint16 or float32"):
        save_scan(Scan(VOLUME + 1, SPACING, large), tmp_path / "bag.tif")
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_what_cannot_be_written_is_named_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"can write \.npz"):
        save_scan(scan(), tmp_path / "bag.txt")
    with pytest.raises(ValueError, match="uint8, uint16 or float32"):
        save_scan(Scan(VOLUME.astype(np.int64), SPACING), tmp_path / "bag.tif")
    with pytest.raises(FileNotFoundError, match="no folder"):
        save_scan(scan(), tmp_path / "nowhere" / "bag.npz")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", [".npz", ".nii.gz", ".mha", ".nrrd", ".tif"])
@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (Scan(VOLUME, SPACING, LABELS[1:]), r"one shape, got \(4, 5, 6\) and \(3, 5, 6\)"),
        (Scan(VOLUME, (0.0, 1.0, 1.0), LABELS), "the voxel size in the scan must be"),
        (Scan(VOLUME[0], SPACING), "the volume must hold a 3D volume"),
        (Scan(VOLUME, SPACING, LABELS + 0.5), "the labels must hold object IDs"),
        (Scan(VOLUME, SPACING, LABELS.astype(np.int16) - 1), "the labels must not hold negative"),
        (Scan(VOLUME, SPACING, scanner_from_scan=2 * np.eye(4)), "the scan must tell where"),
    ],
)
def test_a_scan_that_could_not_be_read_is_not_written(
    tmp_path: Path, suffix: str, wrong: Scan, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        save_scan(wrong, tmp_path / f"bag{suffix}")
    assert not list(tmp_path.iterdir())


def test_a_packed_file_is_read_and_not_the_unpacked_one_beside_it(tmp_path: Path) -> None:
    packed, other = np.full((4, 5, 6), 7, np.int16), np.full((3, 5, 6), 9, np.int16)
    save_scan(Scan(packed, (1.0, 1.0, 1.0)), tmp_path / "scan.nii.gz")
    save_scan(Scan(other, (1.0, 1.0, 1.0)), tmp_path / "scan.nii")
    np.testing.assert_array_equal(load_volume(tmp_path / "scan.nii.gz").volume, packed)
    np.testing.assert_array_equal(load_volume(tmp_path / "scan.nii").volume, other)
