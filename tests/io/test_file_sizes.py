"""What files ask for is compared with what they hold and with the memory before it is taken."""

import gzip
import re
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from napari_unpack import file_sizes, memory
from napari_unpack.file_sizes import TooLargeError, check_array, check_size
from napari_unpack.io import Scan, load_volume, open_session, save_scan, save_session
from napari_unpack.segmentation import Oracle
from napari_unpack.session import Session

# Zeros, which all formats pack to nearly nothing: 2 MB.
EMPTY = np.zeros((100, 100, 100), np.uint16)


def _tiff(path: Path) -> None:
    import tifffile

    tifffile.imwrite(path, EMPTY, compression="zlib", photometric="minisblack")


def _zarr(path: Path) -> None:
    import zarr

    zarr.create_array(str(path), data=EMPTY, chunks=(50, 100, 100), zarr_format=2)


def _session(path: Path) -> None:
    labels = EMPTY.copy()
    labels[40:60, 40:60, 40:60] = 1
    save_session(Session(labels, labels), path)


def _scan(path: Path) -> None:
    save_scan(Scan(EMPTY, (1.0, 1.0, 1.0)), path)


BOMBS: dict[str, Callable[[Path], None]] = {
    "a.npz": _scan,
    "a.nii.gz": _scan,
    "a.mha": _scan,
    "a.nrrd": _scan,
    "a.tif": _tiff,
    "a.zarr": _zarr,
    "a.unpack": _session,
}


@pytest.mark.parametrize("name", BOMBS)
def test_what_would_fill_the_memory_is_read_on_a_persons_word_alone(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, read = tmp_path / name, open_session if name == "a.unpack" else load_volume
    BOMBS[name](path)
    assert read(path).volume.shape == EMPTY.shape
    # Below a gigabyte nothing is asked; the same bytes stand for more.
    monkeypatch.setattr(file_sizes, "UNASKED", 1000)
    monkeypatch.setattr(file_sizes, "LARGEST_RATIO", 3)
    with pytest.raises(TooLargeError, match=rf"{name} has [\d,]+ bytes and would become .* GB"):
        read(path)
    monkeypatch.setattr(file_sizes, "free_memory", lambda: 1000)
    with pytest.raises(TooLargeError, match=rf"{name} holds .* GB, .* free; .*--large .large=True"):
        read(path)
    assert read(path, large=True).volume.shape == EMPTY.shape


def test_memory_is_asked_for_where_there_is_less_than_twice_the_volume() -> None:
    free = file_sizes.free_memory()
    assert 1 << 24 < free < 1 << 50
    check_size("a.npy", free // 3, free)
    with pytest.raises(TooLargeError, match="GB are free"):
        check_size("a.npy", free, free)


def test_files_a_container_has_read_leave_its_memory_free(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory, "CONTROL_GROUP", tmp_path)
    (tmp_path / "memory.max").write_text("1000\n")
    (tmp_path / "memory.current").write_text("900\n")
    assert memory.free_memory() == 100
    (tmp_path / "memory.stat").write_text("anon 200\nfile 700\ninactive_file 600\n")
    assert (memory.free_memory(), memory.total_memory()) == (700, 1000)
    (tmp_path / "memory.max").write_text("max\n")
    assert memory.free_memory() > 1 << 24


def _header(shape: str, version: int = 1) -> bytes:
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    size = len(text).to_bytes(2 if version == 1 else 4, "little")
    return b"\x93NUMPY" + bytes((version, 0)) + size + text.encode()


@pytest.mark.parametrize("shape", ["(50000, 50000, 50000)", f"({10**30}, 1, 1)", "(2, 2, 2)"])
@pytest.mark.parametrize("version", [1, 2])
def test_a_header_is_compared_with_what_follows_it(
    tmp_path: Path, shape: str, version: int
) -> None:
    # A header alone: the numbers it promises are not there.
    head = _header(shape, version)
    (tmp_path / "a.npy").write_bytes(head)
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("volume.npy", head)
    for name in ("a.npy", "a.npz"):
        with pytest.raises(ValueError, match=rf"{name} is not whole: its header asks for"):
            load_volume(tmp_path / name)
    with pytest.raises(ValueError, match=r"a.npz is not whole"):
        Oracle.load(tmp_path / "a.npz")


def test_arrays_of_structures_are_no_volume(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.zeros((2, 2, 2), [("λ", "f8")]))
    with path.open("rb") as stream, pytest.raises(ValueError, match="must hold plain numbers"):
        check_array(stream, path, path.stat().st_size)
    np.save(path, np.full((2, 2, 2), None), allow_pickle=True)
    with pytest.raises(ValueError, match=r"a.npy holds Python objects, .* save it as numbers"):
        load_volume(path)


def test_objects_of_python_are_no_numbers_and_no_names(tmp_path: Path) -> None:
    path = tmp_path / "odd.npz"
    ids, names = np.ones((2, 2, 2), np.uint8), np.array(["", "Mug"], object)
    np.savez(path, volume=ids, labels=ids, spacing=np.ones(3), names=names)
    back = load_volume(path)
    assert (back.names, back.assumed) == (
        None,
        ("its names are no plain text: they were left out",),
    )
    np.savez(path, volume=ids.astype(object))
    with pytest.raises(ValueError, match=r"'volume' of .*odd.npz holds Python .* save it as num"):
        load_volume(path)


META = "ObjectType = Image\nNDims = 3\nDimSize = 9000 9000 9000\nElementType = MET_SHORT\n"
NRRD = "NRRD0004\ntype: short\ndimension: 3\nsizes: 9000 9000 9000\nencoding: raw\nendian: little\n"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.mha", META + "ElementDataFile = LOCAL\n"),
        ("a.mhd", META + "ElementDataFile = a.raw\n"),
        ("a.nrrd", NRRD + "\n"),
        ("a.nhdr", NRRD + "data file: a.raw\n"),
    ],
)
def test_voxels_that_are_not_there_are_missed_before_memory_is_taken(
    tmp_path: Path, name: str, text: str
) -> None:
    (tmp_path / name).write_text(text)
    (tmp_path / "a.raw").write_bytes(b"12345678")
    with pytest.raises(ValueError, match=rf"{name} is not whole: its header asks for 1,458,000"):
        load_volume(tmp_path / name)


def test_a_nifti_file_that_is_cut_short_is_not_taken_for_a_large_one(tmp_path: Path) -> None:
    path = tmp_path / "a.nii"
    _scan(path)
    # By the standard the number of axes and their lengths begin at byte 40.
    head = bytearray(path.read_bytes())
    struct.pack_into("<4h", head, 40, 3, 9000, 9000, 9000)
    path.write_bytes(head)
    with pytest.raises(ValueError, match=r"a.nii is not whole: its header asks for"):
        load_volume(path)


OUTSIDE = ("../a.raw", "/etc/passwd", r"\\host\share\a.raw", "//host/share/a.raw", r"C:\a.raw")


@pytest.mark.parametrize("place", OUTSIDE)
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.mhd", META + "ElementDataFile = {}\n"),
        ("a.mha", META.replace("3\nDim", "3 ElementDataFile: {}\nDim") + "ElementDataFile = LOCAL"),
        ("a.mhd", META + "ElementDataFile = LIST\nb.raw\n{}\n"),
        ("a.nhdr", NRRD + "data file: {}\n"),
        ("a.nrrd", NRRD + "DataFile:  {}\n\n"),
        ("a.nhdr", NRRD + "data file: LIST\nb.raw\n{}\n"),
        ("a.nii", NRRD + "data file: {}\n"),
    ],
)
def test_a_header_leads_nowhere_outside_its_folder(
    tmp_path: Path, name: str, text: str, place: str
) -> None:
    path = tmp_path / name
    path.write_text(text.format(place))
    sentence = rf"{name} says that its voxels are in {re.escape(repr(place))}, outside its folder"
    with pytest.raises(ValueError, match=sentence):
        load_volume(path)


def test_voxels_beside_their_header_or_below_it_are_read(tmp_path: Path) -> None:
    below = tmp_path / "slices"
    below.mkdir()
    voxels = np.arange(24, dtype="<i2").reshape(2, 3, 4)
    for k, plane in enumerate(voxels):
        (below / f"{k}.raw").write_bytes(plane.tobytes())
    (tmp_path / "a.raw").write_bytes(voxels.tobytes())
    (tmp_path / "a.gz").write_bytes(gzip.compress(voxels.tobytes()))
    meta, nrrd = META.replace("9000 9000 9000", "4 3 2"), NRRD.replace("9000 9000 9000", "4 3 2")
    headers = {
        "a.mhd": meta + "ElementDataFile = a.raw\n",
        "b.mhd": meta + "ElementDataFile = LIST\nslices/0.raw\nslices/1.raw\n",
        "c.mhd": meta + "ElementDataFile = slices/%d.raw 0 1 1\n",
        "a.nhdr": nrrd + "data file: a.raw\n",
        "b.nhdr": nrrd.replace("raw", "gzip") + "data file: a.gz\n",
        "c.nhdr": nrrd + "data file: LIST\nslices/0.raw\nslices/1.raw\n",
        "d.nhdr": nrrd + "data file: slices/%d.raw 0 1 1\n",
    }
    for name, text in headers.items():
        (tmp_path / name).write_text(text)
        np.testing.assert_array_equal(load_volume(tmp_path / name).volume, voxels, name)
    (tmp_path / "a.raw").unlink()
    with pytest.raises(
        FileNotFoundError, match=r"a.mhd says that its voxels are in .*a.raw, which is not there"
    ):
        load_volume(tmp_path / "a.mhd")


def test_an_image_in_several_files_has_them_in_its_folder(tmp_path: Path) -> None:
    import tifffile

    path = tmp_path / "a.ome.tif"
    tifffile.imwrite(path, EMPTY[:4, :5, :6], metadata={"axes": "ZYX"})
    with tifffile.TiffFile(path) as file:
        text = str(file.ome_metadata)
    block = '<TiffData><UUID FileName="//host/share/b.ome.tif">urn:uuid:1</UUID></TiffData>'
    forged = re.sub(r"<TiffData.*?(/>|</TiffData>)", block, text)
    assert forged != text
    tifffile.imwrite(path, EMPTY[:4, :5, :6], description=forged, photometric="minisblack")
    with pytest.raises(ValueError, match=r"a.ome.tif says .* '//host/share/b.ome.tif', outside"):
        load_volume(path)
