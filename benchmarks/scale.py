"""What segmentation costs a voxel, from 4 million voxels to 512 x 512 x 1024.

Run `python -m benchmarks.scale`. One simulated bag is enlarged trilinearly to three sizes, white
noise added to each, and every size is segmented in a process of its own, whose peak of resident
memory is reported. The volumes are kept in a folder for temporary files.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

SHAPE, COUNT, SPACING = (128, 128, 256), 27, 2.4
"""Of the bag before it is enlarged; spacing in mm."""
FACTORS = (1, 2, 4)
NOISE = 12.0
CACHE = Path(tempfile.gettempdir()) / "napari-unpack-scale"


@dataclass(frozen=True)
class Cost:
    """What one size costs.

    Parameters
    ----------
    shape : tuple of int
        Voxels z y x.
    seconds : float
        For labels and table.
    peak : float
        Resident memory at most, bytes, of which the volume itself is part.
    objects : int
        Found.
    f1, iou : float
        Against the truth, enlarged too; see `napari_unpack.score`.
    filled : float
        Share of voxels that are some object.
    """

    shape: tuple[int, ...]
    seconds: float
    peak: float
    objects: int
    f1: float
    iou: float
    filled: float

    @property
    def voxels(self) -> int:
        """Number of voxels."""
        return int(np.prod(self.shape))


def enlarged(volume: NDArray[np.uint16], factor: int, path: Path) -> None:
    """Write a volume enlarged trilinearly, with noise, as an .npy file."""
    shape = tuple(n * factor for n in volume.shape)
    result = np.lib.format.open_memmap(path, mode="w+", dtype=np.uint16, shape=shape)
    rng = np.random.default_rng(0)
    for z in range(shape[0]):
        plane = np.empty(shape[1:], np.float32)
        _plane(volume, factor, z, plane)
        plane += rng.standard_normal(plane.shape, np.float32) * NOISE
        result[z] = np.clip(plane, 0, 32000)
    result.flush()


@njit(cache=True)
def _plane(volume, factor, z, plane):  # type: ignore[no-untyped-def]
    depth, height, width = volume.shape
    c = min(max((z + 0.5) / factor - 0.5, 0.0), depth - 1.0)
    k = min(int(c), depth - 2)
    for y in range(plane.shape[0]):
        b = min(max((y + 0.5) / factor - 0.5, 0.0), height - 1.0)
        j = min(int(b), height - 2)
        for x in range(plane.shape[1]):
            a = min(max((x + 0.5) / factor - 0.5, 0.0), width - 1.0)
            i = min(int(a), width - 2)
            total = 0.0
            for dz in range(2):
                for dy in range(2):
                    for dx in range(2):
                        weight = abs(1 - dz - (c - k)) * abs(1 - dy - (b - j))
                        weight *= abs(1 - dx - (a - i))
                        total += weight * volume[k + dz, j + dy, i + dx]
            plane[y, x] = total


def prepared(factor: int) -> Path:
    """Return the file of one size, making it if there is none."""
    from napari_unpack import simulate_bag

    CACHE.mkdir(exist_ok=True)
    path, truth = CACHE / f"volume-{factor}.npy", CACHE / "truth.npy"
    if not path.exists() or not truth.exists():
        bag = simulate_bag(seed=7, shape=SHAPE, count=COUNT, spacing=(SPACING,) * 3)
        np.save(truth, bag.labels)
        enlarged(bag.volume, factor, path)
    return path


def cost(factor: int) -> Cost:
    """Measure one size in a process of its own."""
    prepared(factor)
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.scale", "--one", str(factor)],
        capture_output=True,
        text=True,
        check=True,
    )
    return Cost(**json.loads(done.stdout.splitlines()[-1]))


def load_kernels() -> None:
    """Read compiled code from its cache, or make it, which is no part of what is measured."""
    from napari_unpack import segment

    small = np.load(prepared(1))[:64, :64, :64]
    segment(small, (SPACING,) * 3)
    segment(small, (SPACING,) * 3, working=60_000)


def measured_here(factor: int) -> Cost:
    """Segment one size in this process."""
    import resource

    from napari_unpack import score, segment

    spacing = (SPACING / factor,) * 3
    load_kernels()
    volume = np.load(CACHE / f"volume-{factor}.npy")
    start = time.perf_counter()
    found = segment(volume, spacing)
    seconds = time.perf_counter() - start
    unit = 1 if sys.platform == "darwin" else 1024
    peak = float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * unit
    # Scored where the truth was made; the volume is only an enlargement of it.
    middle = slice(factor // 2, None, factor)
    truth = np.load(CACHE / "truth.npy")
    result = score(truth, np.ascontiguousarray(found.labels[middle, middle, middle]))
    filled = float((truth > 0).mean())
    return Cost(
        volume.shape, seconds, peak, len(found.objects), result["f1"], result["mean_iou"], filled
    )


def main(argv: list[str] | None = None) -> None:
    """Print the table, or one size for the process that asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--one", type=int, help="segment this enlargement in this process")
    parser.add_argument("--factors", type=int, nargs="*", default=FACTORS)
    options = parser.parse_args(argv)
    if options.one:
        print(json.dumps(asdict(measured_here(options.one))))
        return
    prepared(1)
    print(f"{'shape':>16}{'seconds':>9}{'us/voxel':>10}{'peak GB':>9}{'B/voxel':>9}{'F1':>6}")
    for factor in options.factors:
        print(line(cost(factor)), flush=True)


def line(found: Cost) -> str:
    """Return one size as a line of text."""
    shape = "x".join(map(str, found.shape))
    each = found.seconds / found.voxels * 1e6
    memory = f"{found.peak / 1e9:9.2f}{found.peak / found.voxels:9.1f}"
    return f"{shape:>16}{found.seconds:9.1f}{each:10.3f}{memory}{found.f1:6.2f}"


def flatness(costs: list[Cost]) -> float:
    """Return the largest over the smallest time a voxel by which a larger volume is dearer."""
    each: list[Any] = [c.seconds / c.voxels for c in sorted(costs, key=lambda c: c.voxels)]
    return float(max(b / a for k, b in enumerate(each) for a in each[: k + 1]))


if __name__ == "__main__":
    main()
