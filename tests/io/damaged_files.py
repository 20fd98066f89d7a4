"""Open files that are damaged in any way: a result, or one sentence that names the file.

Run as `python tests/io/damaged_files.py SECONDS [SEED]`, as `make fuzz` does; ends with status 1
and the seed of the case at the first error of another kind.
"""

from __future__ import annotations

import json
import shutil
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from napari_unpack.io import Scan, load_volume, open_session, save_scan, save_session
from napari_unpack.segmentation.confidence.oracle import Oracle, default_oracle
from napari_unpack.session import Session

VOLUME = np.arange(4 * 5 * 6, dtype=np.uint16).reshape(4, 5, 6)
# What numbers of a damaged manifest become.
ODD = (0, -1, 1e308, -1e308, 2**63, 1e-320, "", "x", None, True, [], {}, [[]], "\0", float("inf"))


def whole_files(folder: Path) -> list[Path]:
    """Write one good file of every format that is read."""
    import pydicom
    import tifffile
    import zarr

    labels = np.zeros(VOLUME.shape, np.uint16)
    labels[1:3, 1:4, 1:5] = 1
    paths = [folder / f"a{s}" for s in (".npz", ".nii", ".nii.gz", ".mha", ".nrrd", ".tif")]
    for path in paths:
        save_scan(Scan(VOLUME, (1.0, 2.0, 3.0)), path)
    np.save(folder / "a.npy", VOLUME)
    tifffile.imwrite(folder / "b.ome.tif", VOLUME, metadata={"axes": "ZYX", "PhysicalSizeX": 2.0})
    array = zarr.create_array(str(folder / "a.zarr"), data=VOLUME, zarr_format=2)
    assert array.shape == VOLUME.shape
    save_session(Session(VOLUME, labels), folder / "a.unpack")
    save_session(Session(VOLUME, labels), folder / "session")
    default_oracle().save(folder / "oracle.npz")
    data = pydicom.Dataset()
    data.file_meta = pydicom.dataset.FileMetaDataset()
    data.file_meta.TransferSyntaxUID = pydicom.uid.ExplicitVRLittleEndian
    data.file_meta.MediaStorageSOPClassUID = data.SOPClassUID = pydicom.uid.CTImageStorage
    data.file_meta.MediaStorageSOPInstanceUID = data.SOPInstanceUID = "1.2.3"
    data.Modality, data.NumberOfFrames = "CT", len(VOLUME)
    data.Rows, data.Columns = VOLUME.shape[1:]
    data.SamplesPerPixel, data.PhotometricInterpretation = 1, "MONOCHROME2"
    data.BitsAllocated = data.BitsStored = 16
    data.HighBit, data.PixelRepresentation, data.PixelSpacing = 15, 0, [1, 2]
    data.PixelData = VOLUME.tobytes()
    data.save_as(folder / "a.dcm", enforce_file_format=True)
    return sorted(folder.iterdir())


def damaged(raw: bytes, rng: np.random.Generator) -> bytes:
    """Return bytes cut off, changed, moved, or with others between them."""
    array, way = np.frombuffer(raw, np.uint8).copy(), rng.integers(5)
    at = int(rng.integers(len(array)))
    if way == 0:
        return bytes(array[:at])
    if way == 1:
        places = rng.integers(0, len(array), rng.integers(1, 9))
        array[places] = rng.integers(0, 256, len(places))
    elif way == 2:
        # Headers stand in front, where few bytes say much.
        places = rng.integers(0, min(len(array), 400), rng.integers(1, 5))
        array[places] = rng.choice([0, 1, 127, 128, 255], len(places))
    elif way == 3:
        array = np.insert(array, at, rng.integers(0, 256, rng.integers(1, 60)).astype(np.uint8))
    else:
        array = np.roll(array, at)
    return array.tobytes()


def damaged_record(record: Any, rng: np.random.Generator) -> Any:
    """Return plain data with one value somewhere in it replaced, left out or doubled."""
    if isinstance(record, dict) and record and rng.random() < 0.93:
        key = str(rng.choice(sorted(record)))
        if rng.random() < 0.1:
            return {k: v for k, v in record.items() if k != key}
        return record | {key: damaged_record(record[key], rng)}
    if isinstance(record, list) and record and rng.random() < 0.9:
        k = int(rng.integers(len(record)))
        if rng.random() < 0.2:
            return record[:k] + record[k + 1 :]
        return [*record[:k], damaged_record(record[k], rng), *record[k + 1 :]]
    return ODD[int(rng.integers(len(ODD)))]


def damage(path: Path, rng: np.random.Generator) -> None:
    """Damage a file, one file of a folder, or the manifest of a session."""
    if path.is_dir() and (path / "session.json").exists() and rng.random() < 0.7:
        manifest = path / "session.json"
        record = damaged_record(json.loads(manifest.read_text()), rng)
        manifest.write_text(json.dumps(record))
        return
    if path.suffix == ".unpack" and rng.random() < 0.3:
        with zipfile.ZipFile(path) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        chosen = str(rng.choice(sorted(members)))
        with zipfile.ZipFile(path, "w") as archive:
            for name, raw in members.items():
                archive.writestr(name, damaged(raw, rng) if name == chosen else raw)
        return
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    file = files[int(rng.integers(len(files)))]
    file.write_bytes(damaged(file.read_bytes(), rng))


def open_any(path: Path) -> None:
    """Open a file of any kind."""
    if path.suffix == ".unpack" or path.name == "session":
        open_session(path)
    elif path.name == "oracle.npz":
        Oracle.load(path)
    else:
        load_volume(path)


def cases(seed: int, room: Path) -> Iterator[tuple[int, Path, Exception | None]]:
    """Damage one file after another without end; yield what opening it raised."""
    good = room / "good"
    good.mkdir(parents=True)
    files = whole_files(good)
    for path in files:
        open_any(path)
    # A name that a message can be searched for.
    bad = room / "damaged"
    while True:
        rng = np.random.default_rng(seed)
        source = files[seed % len(files)]
        shutil.rmtree(bad, ignore_errors=True)
        bad.mkdir()
        path = bad / source.name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, path)
        damage(path, rng)
        try:
            open_any(path)
        except Exception as error:
            yield seed, path, error
        else:
            yield seed, path, None
        seed += 1


def is_told(error: Exception | None, path: Path) -> bool:
    """Tell whether opening went well, or said in one sentence what is wrong with which file."""
    if error is None:
        return True
    sentence = str(error)
    return (
        isinstance(error, ValueError | FileNotFoundError)
        and path.name in sentence
        and "\n" not in sentence
        and len(sentence) < 600
    )


def main(seconds: float, seed: int = 0) -> int:
    """Try until the time is over."""
    end, count = time.monotonic() + seconds, 0
    with tempfile.TemporaryDirectory() as room:
        for case, path, error in cases(seed, Path(room)):
            count += 1
            if not is_told(error, path):
                print(f"seed {case}, {path.name}: {error!r}")
                return 1
            if time.monotonic() > end:
                break
    print(f"{count} damaged files: each a result or one sentence")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(float(sys.argv[1]), *map(int, sys.argv[2:])))
