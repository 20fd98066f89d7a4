"""Make the pictures of the page of examples: each example is run, and what it wrote is shown.

`make screenshots` does so; `python tools/example_pictures.py FOLDER` does so alone.
"""

from __future__ import annotations

import colorsys
import csv
import runpy
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
from gallery_pictures import SIDE, captioned, save
from numpy.typing import NDArray
from PIL import Image, ImageOps

import napari_unpack as nu

EXAMPLES = Path(__file__).parents[1] / "examples"
VIEW = nu.View(direction=(0.35, 0.5, 0.8), fov=20)
GROUND = (14, 16, 20)
# From blue for 0 to yellow for 1, which everybody tells apart.
BLUE, YELLOW = 0.62, 0.15

Panels = Iterator[tuple[NDArray[Any], str]]
Hues = Mapping[int, float]


def draw_examples(gallery: Path) -> Iterator[Path]:
    """Run every example and write one picture of each, `example-NAME.png`.

    Parameters
    ----------
    gallery : Path
        A folder.
    """
    for name, panels in SHOWN.items():
        path = gallery / f"example-{name.replace('_', '-')}.png"
        with tempfile.TemporaryDirectory() as folder:
            sys.argv = [name, folder]
            made = runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
            shown = [captioned(panel, words) for panel, words in panels(Path(folder), made)]
        save(np.hstack(shown), path)
        yield path


def _segmented(folder: Path, made: Mapping[str, Any]) -> Panels:
    bag, labels = _small_bag(), np.load(folder / "labels.npy")
    yield _drawn(bag.volume, np.zeros_like(labels), bag.spacing, {}), "the volume"
    yield _drawn(bag.volume, labels, bag.spacing, _hues(labels, bag.spacing, VIEW)), "labels.npy"


def _in_order(folder: Path, made: Mapping[str, Any]) -> Panels:
    bag, rows = _small_bag(), _rows(folder / "order.csv")
    hues = _hues(bag.labels, bag.spacing, VIEW)
    for last in (0, 3, 6):
        gone = [int(row["id"]) for row in rows if int(row["step"]) <= last]
        picture = _drawn(bag.volume, bag.labels, bag.spacing, hues, gone=gone)
        yield picture, f"after step {last}" if last else "before step 1"


def _tinted(folder: Path, made: Mapping[str, Any]) -> Panels:
    yield _square(iio.imread(folder / "tinted.png")), "tinted.png"


def _labelled(folder: Path, made: Mapping[str, Any]) -> Panels:
    labels, spacing = made["labels_of_another_tool"](), made["SPACING"]
    free = {int(row["id"]): 1 - float(row["exact"]) for row in _rows(folder / "objects.csv")}
    volume, view = np.where(labels > 0, 1000, 0).astype(np.uint16), nu.View(direction=(1, 0, 0))
    hues = _hues(labels, spacing, view)
    yield _drawn(volume, labels, spacing, hues, view), "objects of another tool"
    yield _drawn(volume, labels, spacing, _scale(free), view), "yellow is unpackable"


def _filmed(folder: Path, made: Mapping[str, Any]) -> Panels:
    frames = iio.imread(folder / "unpacking.mp4")
    for share in (0.0, 0.35, 0.7, 1.0):
        at = round(share * (len(frames) - 1))
        yield _square(frames[at]), f"frame {at + 1}"


def _trained(folder: Path, made: Mapping[str, Any]) -> Panels:
    bag, own = _small_bag(), nu.Oracle.load(folder / "oracle.npz")
    for oracle, words in ((own, "oracle.npz: yellow is sure"), (None, "as shipped")):
        found = nu.segment(bag.volume, bag.spacing, oracle=oracle)
        sure = {int(i): float(c) for i, c in found.objects["confidence"].items()}
        yield _drawn(bag.volume, found.labels, bag.spacing, _scale(sure)), words


SHOWN: dict[str, Callable[[Path, Mapping[str, Any]], Panels]] = {
    "segment_a_volume": _segmented,
    "unpack_in_order": _in_order,
    "tinted_picture": _tinted,
    "own_labels": _labelled,
    "movie_of_unpacking": _filmed,
    "train_confidence": _trained,
}


def _small_bag() -> Any:
    """Return the bag that the examples simulate."""
    return nu.simulate_bag(seed=1, shape=(64, 72, 96), count=10)


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _hues(labels: NDArray[Any], spacing: Any, view: Any) -> Hues:
    layers = nu.object_id_layers(labels, spacing, view, layers=2)
    return nu.assign_hues(nu.interference(layers, distance=5), margin=0.4)


def _scale(values: Mapping[int, float]) -> Hues:
    return {i: BLUE + value * (YELLOW - BLUE) for i, value in values.items()}


def _drawn(
    volume: NDArray[Any],
    labels: NDArray[Any],
    spacing: Any,
    hues: Hues,
    view: Any = VIEW,
    gone: Any = (),
) -> NDArray[Any]:
    image = nu.render(
        volume,
        labels,
        spacing,
        view,
        tints={i: colorsys.hsv_to_rgb(hue, 0.9, 1) for i, hue in hues.items()},
        hidden=(*((0,) if hues else ()), *gone),
        size=(SIDE, SIDE),
        background="dark",
    )
    return np.asarray(image[..., :3])


def _square(image: NDArray[Any]) -> NDArray[Any]:
    """Return a picture in a square, 0 to 1."""
    padded = ImageOps.pad(Image.fromarray(image), (SIDE, SIDE), color=GROUND)
    return np.asarray(padded) / 255


if __name__ == "__main__":
    for written in draw_examples(Path(sys.argv[1])):
        print(written.name)
