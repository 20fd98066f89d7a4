"""Make the pictures of docs/gallery with the plugin itself: `make screenshots`.

The simulated bag always; the backpack where shared/data beside the repository holds it.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path

from example_pictures import draw_examples
from figures import LOOKING, film
from figures import draw as draw_figures
from gallery_pictures import draw, open_session_on
from segmentation_picture import draw_segmentation

from napari_unpack import segment, simulate_bag
from napari_unpack.demo import run
from napari_unpack.io import load_volume

ROOT = Path(__file__).parents[1]
BACKPACK = ROOT.parent / "shared" / "data" / "backpack.npz"
FROM_ABOVE = (0.3, 0.25, 1.0)
PICTURES = ("window", "packed", "flight", "unpacked", "inspect")


def main(gallery: Path) -> None:
    """Film both bags and keep their pictures."""
    gallery.mkdir(parents=True, exist_ok=True)
    for name, source in (("bag", None), ("backpack", BACKPACK)):
        if source is not None and not source.exists():
            print(f"{source.name} is not there: its pictures stay as they are")
            continue
        with tempfile.TemporaryDirectory() as folder:
            run(source, None, Path(folder))
            for picture in PICTURES:
                shutil.copy(Path(folder) / f"{picture}.png", gallery / f"{name}-{picture}.png")
        if source is None:
            bag = simulate_bag(seed=0)
            session = open_session_on(bag.volume, bag.labels, bag.spacing, (0.55, 0.35, 0.9))
        else:
            scan = load_volume(source)
            labels = segment(scan.volume, scan.spacing).labels
            session = open_session_on(scan.volume, labels, scan.spacing, FROM_ABOVE)
        for path in draw(session, name, gallery, bag_is_ct=source is None):
            print(path.name)
        draw_figures(session, gallery, name, LOOKING if source is None else FROM_ABOVE)
    draw_segmentation(simulate_bag(seed=0), gallery / "bag-segmentation.png")
    film(gallery / "bag-unpacking.gif")
    for path in draw_examples(gallery):
        print(path.name)


if __name__ == "__main__":
    # The panel as everybody has it at first: nothing remembered, and no unsaved work offered.
    with tempfile.TemporaryDirectory() as nobodys:
        os.environ |= {"XDG_CONFIG_HOME": nobodys, "XDG_DATA_HOME": nobodys}
        main(Path(sys.argv[1]))
