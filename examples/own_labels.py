"""Ask about objects that another tool has labelled: who is occluded, and who interferes.

Run `python own_labels.py [FOLDER]`. The labels come from scikit-image's watershed on a small
heap of balls; put in your own label volume instead. Objects leave towards -z, so the view looks
along +z. Writes objects.csv. Prints the same table: the occlusion ratio of each object as the paper
counts it (`first_hit`), the stricter one that a straight pull needs (`exact`), and who interferes
with it; and then which objects nothing stands in the way of.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from skimage.segmentation import watershed

import napari_unpack as nu

SPACING = (1.5, 1.0, 1.0)


def labels_of_another_tool() -> NDArray[np.integer]:
    """Label a heap of touching balls."""
    middles = np.random.default_rng(0).uniform(10, (30, 54, 54), size=(12, 3))
    z, y, x = np.ogrid[:40, :64, :64]
    balls = [((z - a) * 1.5) ** 2 + (y - b) ** 2 + (x - c) ** 2 < 81 for a, b, c in middles]
    inside, seeds = np.any(balls, axis=0), np.zeros((40, 64, 64), int)
    seeds[tuple(middles.round().astype(int).T)] = np.arange(1, 13)
    return np.asarray(watershed(-distance_transform_edt(inside, SPACING), seeds, mask=inside))


def main(folder: Path) -> None:
    """Measure occlusion and interference and write them into a folder."""
    labels, view = labels_of_another_tool(), nu.View(direction=(1, 0, 0))
    table = pd.DataFrame(index=pd.Index(range(1, 13), name="id"))
    table["first_hit"] = nu.occlusion_ratios(labels, SPACING, view, definition="first_hit")
    table["exact"] = nu.occlusion_ratios(labels, SPACING, view, definition="exact")
    graph = nu.interference(nu.object_id_layers(labels, SPACING, view, layers=2), distance=5)
    table["interferes_with"] = [" ".join(map(str, sorted(graph[i]))) for i in table.index]
    table.sort_values("exact").to_csv(folder / "objects.csv")
    print(table.sort_values("exact").round(3).to_string())
    print("nothing stands in the way of:", *table.index[table["exact"] == 0])


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path()
    target.mkdir(parents=True, exist_ok=True)
    main(target)
