"""Open files that are damaged in any way: a result, or one sentence that names the file.

Run as `python tests/io/damaged_files.py CASES SECONDS [SEED]`, as `make fuzz` does: so many cases
of each reader, or as many as time lets; ends with status 1 if one ended otherwise. A case is a
number, its seed, and says all of what is damaged: it is kept by its number, in `KEPT`. In `make
test` Hypothesis draws every choice instead, and makes what fails small; see `Drawn`.
"""

from __future__ import annotations

import gzip
import io
import json
import shutil
import sys
import tempfile
import time
import warnings
import zipfile
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import count
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from napari_unpack.io import Scan, load_volume, open_session, save_scan, save_session
from napari_unpack.io.label_names import load_label_names
from napari_unpack.segmentation.confidence.oracle import Oracle, default_oracle
from napari_unpack.session import Session

# Cases that once ended in something else than a sentence.
KEPT = (646, 1216, 1336)
# Files that `whole_files` writes.
READERS = 15

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
    # The same once more, of which only the manifest is damaged.
    save_session(Session(VOLUME, labels), folder / "manifest")
    (folder / "labels.ctbl").write_text("1 Shoe 255 0 0 255\n2 Bottle_of_water 0 9 255 255\n")
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


class Drawn:
    """Makes the choices of a `numpy.random.Generator` with a `Random` that Hypothesis draws from.

    Parameters
    ----------
    source : random.Random
    """

    def __init__(self, source: Random) -> None:
        self._source = source

    def random(self) -> float:
        """Return a number in [0, 1)."""
        return self._source.random()

    def integers(self, low: int, high: int | None = None, size: Any = None) -> Any:
        """Return a whole number below `high`, or so many."""
        low, high = (0, low) if high is None else (low, high)
        if size is None:
            return self._source.randrange(int(low), int(high))
        return np.array([self.integers(low, high) for _ in range(int(size))], np.int64)

    def choice(self, of: Any, size: Any = None) -> Any:
        """Return one of several, or so many."""
        if size is None:
            return of[self.integers(len(of))]
        return np.array([self.choice(of) for _ in range(int(size))])


Choices = np.random.Generator | Drawn


def damaged(raw: bytes, rng: Choices) -> bytes:
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


def damaged_record(record: Any, rng: Choices) -> Any:
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


def damage(path: Path, rng: Choices) -> None:
    """Damage a file, one file of a folder, what a compressed file holds, or a manifest."""
    if path.name == "manifest":
        manifest = path / "session.json"
        record = damaged_record(json.loads(manifest.read_text()), rng)
        manifest.write_text(json.dumps(record))
        return
    files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    file = files[int(rng.integers(len(files)))]
    raw = file.read_bytes()
    # Inside, where checksums of the format are right again and readers believe what they read.
    inside = rng.random() < 0.6
    if inside and zipfile.is_zipfile(file):
        file.write_bytes(damaged_archive(raw, rng))
    elif inside and file.suffix == ".gz":
        file.write_bytes(gzip.compress(damaged(gzip.decompress(raw), rng), 1))
    else:
        file.write_bytes(damaged(raw, rng))


def damaged_archive(raw: bytes, rng: Choices) -> bytes:
    """Return a zip file with one of its members damaged, or the member of a member."""
    packed = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(raw)) as old, zipfile.ZipFile(packed, "w") as new:
        chosen = str(rng.choice(sorted(set(old.namelist()))))
        for name in old.namelist():
            member = old.read(name)
            if name == chosen:
                inner = name.endswith(".npz") and rng.random() < 0.7
                member = damaged_archive(member, rng) if inner else damaged(member, rng)
            new.writestr(name, member)
    return packed.getvalue()


def open_any(path: Path) -> None:
    """Open a file of any kind."""
    if path.suffix == ".unpack" or path.name in ("session", "manifest"):
        open_session(path)
    elif path.suffix == ".ctbl":
        load_label_names(path)
    elif path.name == "oracle.npz":
        Oracle.load(path)
    else:
        load_volume(path)


def cases(seeds: Iterable[int], room: Path) -> Iterator[tuple[int, Path, Exception | None]]:
    """Damage a file for each seed, one reader after another; yield what opening it raised."""
    files = good_files(room)
    for seed in seeds:
        yield seed, *one_case(files[seed % len(files)], room, np.random.default_rng(seed))


def good_files(room: Path) -> list[Path]:
    """Write the good files, and open each."""
    good = room / "good"
    good.mkdir(parents=True)
    files = whole_files(good)
    for path in files:
        open_any(path)
    return files


def one_case(source: Path, room: Path, rng: Choices) -> tuple[Path, Exception | None]:
    """Damage a copy of a file; return where it is and what opening it raised."""
    # A name that a message can be searched for.
    bad = room / "damaged"
    shutil.rmtree(bad, ignore_errors=True)
    bad.mkdir()
    path = bad / source.name
    (shutil.copytree if source.is_dir() else shutil.copy)(source, path)
    damage(path, rng)
    try:
        open_any(path)
    except Exception as error:
        return path, error
    return path, None


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


def main(each: int, seconds: float, first: int = 0) -> int:
    """Try so many cases of each reader, or as many as time lets."""
    end, counts, wrong = time.monotonic() + seconds, Counter[str](), 0
    # Libraries write pages about each file to the terminal; a case is a number and its sentence.
    with tempfile.TemporaryDirectory() as room, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for case, path, error in cases(count(first), Path(room)):
            counts[path.name] += 1
            if not is_told(error, path):
                wrong += 1
                print(f"seed {case}, {path.name}: {error!r}")
            if time.monotonic() > end or min(counts.values()) >= each:
                break
    print("; ".join(f"{name} {n:,}" for name, n in sorted(counts.items())))
    print(f"{counts.total():,} damaged files: {wrong} ended in anything but a result or a sentence")
    return int(wrong > 0)


if __name__ == "__main__":
    raise SystemExit(main(int(sys.argv[1]), float(sys.argv[2]), *map(int, sys.argv[3:])))
