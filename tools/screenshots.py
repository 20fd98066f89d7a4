"""Make the pictures of docs/gallery with the plugin itself: `make screenshots`.

The simulated bag always; the backpack where ../shared/data holds it.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from napari_unpack.widgets.demo import run

ROOT = Path(__file__).parents[1]
BACKPACK = ROOT.parent / "shared" / "data" / "backpack.npz"
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


if __name__ == "__main__":
    main(Path(sys.argv[1]))
