"""The boundary network: from density to the affinities of neighbouring voxels and cells."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from napari_unpack.kernels import njit
from napari_unpack.segmentation.common.density_regions import DensityScale
from napari_unpack.tasks import Progress, Share, awaited
from napari_unpack.thread_count import thread_count

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

# Cells between the two of a pair; a cell is 2 x 2 x 2 voxels.
REACHES = (1, 3, 6, 12)
# Of a cell: the probability of each of its 8 voxels to be an object's, the affinity of each with
# the next along z, along y and along x, and that of the cell with the one so many cells further
# along z, y and x.
CHANNELS = 8 + 3 * 8 + 3 * len(REACHES)
# As in training; it stands for 8000 times the knee.
HIGHEST_LOG_DENSITY = 9.0
# Cells: the network halves its grid three times.
STRIDE = 8
# Cells that a tile adds along an axis at most, and what it sees beyond its edge: 88 in all, and
# 88 x 88 x 88 take 0.45 GB.
TILE, MARGIN = 72, 8


@dataclass(frozen=True, eq=False)
class Prediction:
    """What the network predicts of a volume; shares of 255.

    Parameters
    ----------
    foreground : (Z, Y, X) ndarray of uint8
        The probability that a voxel is an object's.
    next : (3, Z, Y, X) ndarray of uint8
        The affinity of a voxel with the next along z, y and x.
    far : (3 * len(REACHES), z, y, x) ndarray of uint8
        The affinity of a cell with the cell so many further, reach by reach, z, y and x.
    """

    foreground: NDArray[np.uint8]
    next: NDArray[np.uint8]
    far: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class BoundaryNetwork:
    """The network.

    Parameters
    ----------
    session : onnxruntime.InferenceSession
        From (1, 8, z, y, x) float32 cells of log density to (1, CHANNELS, z, y, x) uint8.
    """

    session: InferenceSession

    @staticmethod
    def load(path: str | Path, threads: int | None = None) -> BoundaryNetwork:
        """Read a network.

        Parameters
        ----------
        path : str or Path
            An ONNX file that `benchmarks/boundaries/export.py` wrote.
        threads : int, optional
            Used at most; by default two, or fewer where the process takes fewer.

        Raises
        ------
        ValueError
            If the file cannot be read or holds another network.
        """
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads or min(2, thread_count())
        # Threads that wait would otherwise take processor time from other work.
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        # Errors come as exceptions; the library's own log would only repeat them on the terminal.
        options.log_severity_level = 4
        try:
            session = onnxruntime.InferenceSession(
                Path(path).read_bytes(), options, providers=["CPUExecutionProvider"]
            )
            coming, going = session.get_inputs()[0].shape, session.get_outputs()[0].shape
        except OSError:
            raise
        except Exception as error:
            raise ValueError(f"{path} is not a boundary network: {error}") from error
        if coming[1] != 8 or going[1] != CHANNELS:
            raise ValueError(
                f"{path} is not a boundary network of this version; it takes {coming[1]} "
                f"channels and gives {going[1]}, wanted 8 and {CHANNELS}"
            )
        return BoundaryNetwork(session)

    def predict(
        self,
        density: NDArray[np.generic],
        scale: DensityScale,
        progress: Progress,
        tile: int = TILE,
    ) -> Prediction:
        """Predict a volume, tile by tile.

        Parameters
        ----------
        density : (Z, Y, X) ndarray
            Density; NaN counts as air.
        scale : DensityScale
            How it is compressed.
        progress : callable
            Called with (fraction, text) before and during every tile; raising cancels.
        tile : int
            Cells along an axis at most, where it has not to be cut at all: 16 more.
        """
        # About 15 kMAC and 7 bytes of result a voxel; a tile takes about 1 kB a cell. Tiles see 16
        # voxels beyond their edges.
        # An odd last slice shares its cells with air.
        cells = tuple((n + 1) // 2 for n in density.shape)
        foreground = np.zeros(density.shape, np.uint8)
        following = np.zeros((3, *density.shape), np.uint8)
        far = np.zeros((3 * len(REACHES), *cells), np.uint8)
        tiles = list(_tiles(cells, tile))
        share = Share(progress, text="Predicting boundaries")
        packed = (_packed(density, seen, scale) for seen, _ in tiles)
        predicted = self.all_channels(packed, len(tiles), share)
        for (seen, kept), channels in zip(tiles, predicted, strict=True):
            inner = tuple(
                slice(k.start - s.start, k.stop - s.start) for s, k in zip(seen, kept, strict=True)
            )
            # Of one layout, for which the kernel is compiled once.
            channels = np.ascontiguousarray(channels[(slice(None), *inner)])
            far[(slice(None), *kept)] = channels[32:]
            first = tuple(k.start for k in kept)
            _unpack(channels[:8], first, foreground)
            for axis in range(3):
                _unpack(channels[8 + 8 * axis : 16 + 8 * axis], first, following[axis])
        share(1.0)
        return Prediction(foreground, following, far)

    def all_channels(
        self, tiles: Iterator[NDArray[np.float32]], count: int, share: Share
    ) -> Iterator[NDArray[np.uint8]]:
        """Yield what the network says of each tile, in order.

        Parameters
        ----------
        tiles : iterator of (1, 8, z, y, x) ndarray
        count : int
            How many there are.
        share : Share
        """
        for done, tile in enumerate(tiles):
            yield self.channels(tile, share.part(done / count, (done + 1) / count))

    def channels(self, packed: NDArray[np.float32], share: Share) -> NDArray[np.uint8]:
        """Run the network on one tile, which takes a second or two.

        Parameters
        ----------
        packed : (1, 8, z, y, x) ndarray of float32
        share : Share
        """
        import onnxruntime

        options = onnxruntime.RunOptions()
        # Memory is had for a tile and given back; asked for tensor by tensor it is had anew every
        # time, which takes a sixth of the run.
        options.add_run_config_entry("memory.enable_memory_arena_shrinkage", "cpu:0")
        with ThreadPoolExecutor(1, "unpack-network") as thread:
            run = thread.submit(self.session.run, None, {"cells": packed}, options)
            try:
                return np.asarray(awaited(run, share)[0][0])
            except BaseException:
                # Leaving this block waits for the run, which would go on to the end of the tile.
                options.terminate = True
                raise


@cache
def default_boundaries() -> BoundaryNetwork:
    """Return the network that ships with the package."""
    return BoundaryNetwork.load(Path(__file__).parents[1] / "weights" / "boundary_network.onnx")


def _tiles(
    cells: tuple[int, ...], most: int
) -> Iterator[tuple[tuple[slice, ...], tuple[slice, ...]]]:
    """Yield what a tile sees, a multiple of the stride long, and what of it is kept."""
    axes = []
    for count in cells:
        # What a tile in the middle sees is seen at once; a seam less is a margin less as well.
        number = 1 if count <= most + 2 * MARGIN else -(-count // most)
        # Tiles of even length: a narrow last one would cost a margin of its own.
        core = -(-count // number)
        core = -(-core // STRIDE) * STRIDE
        axis = []
        for first in range(0, count, core):
            last = min(first + core, count)
            low = max(first - MARGIN, 0)
            high = min(last + MARGIN, count)
            # A multiple of the stride, or halving would lose the last cells.
            high = low + -(-(high - low) // STRIDE) * STRIDE
            axis.append((slice(low, high), slice(first, last)))
        axes.append(axis)
    for choice in itertools.product(*axes):
        seen, kept = zip(*choice, strict=True)
        yield seen, kept


def _packed(
    density: NDArray[np.generic], seen: tuple[slice, ...], scale: DensityScale
) -> NDArray[np.float32]:
    """Return (1, 8, z, y, x): log density of the voxels of cells, air beyond the volume."""
    block = density[tuple(slice(2 * s.start, 2 * s.stop) for s in seen)]
    # Infinities above are metal, those below and NaN are air.
    values = np.nan_to_num(block.astype(np.float32), nan=scale.air, posinf=1e30, neginf=scale.air)
    lifted = np.log1p(np.maximum(values - scale.air, 0) / scale.knee)
    whole = np.zeros([2 * (s.stop - s.start) for s in seen], np.float32)
    whole[tuple(slice(n) for n in block.shape)] = np.minimum(lifted, HIGHEST_LOG_DENSITY)
    z, y, x = (n // 2 for n in whole.shape)
    cells = whole.reshape(z, 2, y, 2, x, 2).transpose(1, 3, 5, 0, 2, 4)
    return np.ascontiguousarray(cells.reshape(1, 8, z, y, x))


@njit(cache=True, nogil=True)
def _unpack(channels, first, whole):  # type: ignore[no-untyped-def]
    """Write the 8 channels of cells to the voxels of each cell."""
    _, depth, height, width = channels.shape
    for k in range(8):
        for z in range(depth):
            a = 2 * (first[0] + z) + k // 4
            if a >= whole.shape[0]:
                continue
            for y in range(height):
                b = 2 * (first[1] + y) + k // 2 % 2
                if b >= whole.shape[1]:
                    continue
                for x in range(width):
                    c = 2 * (first[2] + x) + k % 2
                    if c < whole.shape[2]:
                        whole[a, b, c] = channels[k, z, y, x]
