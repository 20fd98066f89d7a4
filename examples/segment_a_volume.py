"""Find the objects of a volume and save their labels and a table.

Run `python segment_a_volume.py [FOLDER] [VOLUME.npy]`. Without a volume, a small bag is simulated.
Writes labels.npy (object IDs, 0 is background) and objects.csv (one row for each object) into the
folder. Prints the objects, the most confident first.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import napari_unpack as nu

SPACING = (1.0, 1.0, 1.0)
"""Voxel size of your volume in mm, z y x: sizes are read from it."""


def main(folder: Path, volume: NDArray[np.generic]) -> None:
    """Segment a volume and write what was found into a folder."""
    found = nu.segment(volume, spacing=SPACING)
    np.save(folder / "labels.npy", found.labels)
    found.objects.to_csv(folder / "objects.csv")
    for object_id, row in found.objects.sort_values("confidence", ascending=False).iterrows():
        print(
            f"object {object_id}: confidence {row['confidence']:.2f}, "
            f"{row['volume_mm3'] / 1000:.1f} cm3, mean density {row['mean_density']:.0f}"
        )
    print(f"{len(found.objects)} objects in {folder / 'labels.npy'}")


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path()
    target.mkdir(parents=True, exist_ok=True)
    if len(sys.argv) > 2:
        main(target, np.load(sys.argv[2]))
    else:
        main(target, nu.simulate_bag(seed=1, shape=(64, 72, 96), count=10).volume)
