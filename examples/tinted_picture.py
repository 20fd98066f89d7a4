"""Draw a bag in which every object has a hue that its neighbours in this view do not have.

Run `python tinted_picture.py [FOLDER]`. A small bag is simulated; its labels are known. Writes
tinted.png. Prints how many pairs of objects interfere in this view, and the least hue distance of
such a pair (0.5 is the opposite side of the hue circle).
"""

from __future__ import annotations

import colorsys
import sys
from pathlib import Path

import imageio.v3 as iio

import napari_unpack as nu


def main(folder: Path) -> None:
    """Choose hues for one view, cast the image and write it into a folder."""
    bag = nu.simulate_bag(seed=3, shape=(64, 72, 96), count=14)
    view = nu.View(direction=(0.3, 0.5, 0.8), height=105, fov=20)
    ids = nu.object_id_layers(bag.labels, bag.spacing, view, layers=2, size=(360, 480))
    graph = nu.interference(ids, distance=5)
    hues = nu.assign_hues(graph, margin=0.4)
    image = nu.render(
        bag.volume,
        bag.labels,
        bag.spacing,
        view,
        tints={i: colorsys.hsv_to_rgb(hue, 1, 1) for i, hue in hues.items()},
        hidden=(0,),  # What belongs to no object, such as the bag's own shell.
        size=(360, 480),
        background="dark",
        decorations=("scale",),
    )
    iio.imwrite(folder / "tinted.png", (image[..., :3].clip(0, 1) * 255).round().astype("uint8"))
    apart = [abs((hues[a] - hues[b] + 0.5) % 1 - 0.5) for a, b in graph.edges]
    print(f"{len(hues)} objects in view, {len(apart)} pairs interfere")
    print(f"least hue distance of a pair: {min(apart):.3f}")


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path()
    target.mkdir(parents=True, exist_ok=True)
    main(target)
