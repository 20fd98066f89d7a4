"""napari's reader: File > Open and drag and drop."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

LayerData = tuple[Any, dict[str, Any], str]


def get_reader(path: str | Sequence[str]) -> Callable[[Any], list[LayerData]] | None:
    """Return a reader for what napari was asked to open, None where it is not ours.

    Of several files, the slices of a DICOM series, the first is looked at. Names alone count, so
    that napari stays quick: broken files are reported when read. An .npz is ours if it holds an
    array `volume` or `labels`.
    """
    from napari_unpack.io.volumes import READABLE, suffix_of

    first = Path(path if isinstance(path, str) else path[0])
    if first.is_dir():
        return read_layers if _is_dicom_or_zarr(first) else None
    suffix = suffix_of(first)
    # .npz is anyone's format: only ours are taken, so that other plugins may read the rest.
    if suffix not in READABLE or (suffix == ".npz" and not _is_ours(first)):
        return None
    return read_layers


def read_layers(path: str | Sequence[str]) -> list[LayerData]:
    """Read a file into napari layers: an Image, and Labels where there are any.

    With `scale` and `units` in mm. Names of objects become the labels' `features`.

    Raises
    ------
    FileNotFoundError, ValueError, ImportError
        As for `load_volume`.
    """
    from napari_unpack.io.volumes import load_labels, load_volume, stem_of, suffix_of

    first = Path(path if isinstance(path, str) else path[0])
    # Labels alone are a file too, such as corrected ones.
    if suffix_of(first) == ".npz" and "volume" not in _keys(first):
        labels, spacing = load_labels(first)
        return [(labels, _attributes(spacing, stem_of(first)), "labels")]
    scan = load_volume(first)
    image = _attributes(scan.spacing, scan.name)
    layers: list[LayerData] = [(scan.volume, image | {"colormap": "gray"}, "image")]
    if scan.labels is not None:
        named = {"features": _features(scan.names)} if scan.names else {}
        about = _attributes(scan.spacing, f"{scan.name} labels") | named
        layers.append((scan.labels, about, "labels"))
    return layers


def _attributes(spacing: tuple[float, float, float], name: str) -> dict[str, Any]:
    return {"scale": spacing, "units": ("mm",) * 3, "name": name}


def _features(names: Mapping[int, str]) -> dict[str, list[Any]]:
    """Return names as napari shows them when the mouse is on a label."""
    return {"index": list(names), "name": list(names.values())}


def _keys(path: Path) -> set[str]:
    import zipfile

    try:
        with zipfile.ZipFile(path) as archive:
            # The archive's table of contents: no array is read.
            return {name.removesuffix(".npy") for name in archive.namelist()}
    except (OSError, zipfile.BadZipFile):
        return set()


def _is_ours(path: Path) -> bool:
    keys = _keys(path)
    # A broken archive is ours too: the reader says what is wrong with it.
    return not keys or bool(keys & {"volume", "labels"})


def _is_dicom_or_zarr(folder: Path) -> bool:
    marks = ("zarr.json", ".zgroup", ".zarray")
    if folder.suffix.lower() == ".zarr" or any((folder / mark).exists() for mark in marks):
        return True
    files = (p for p in sorted(folder.rglob("*")) if p.is_file())
    # A series has its slices together: twenty files tell, thousands would take seconds.
    for _, file in zip(range(20), files, strict=False):
        if file.suffix.lower() in (".dcm", ".dicom", ".ima", ".dcs", ".dicos"):
            return True
        # Scanners write DICOM files without a suffix: the mark stands after 128 bytes.
        with file.open("rb") as stream:
            if stream.read(132)[128:] == b"DICM":
                return True
    return False
