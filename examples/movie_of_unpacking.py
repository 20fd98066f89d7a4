"""Make a movie of objects that leave a bag and wait beside it.

Run `python movie_of_unpacking.py [FOLDER]`. A small bag is simulated; its labels are known.
Writes unpacking.mp4 with the first three objects that leave towards the viewer. Prints who they
are and where the movie is. A path that ends in .gif, or a folder for PNG images, works as well.
"""

from __future__ import annotations

import sys
from pathlib import Path

import napari_unpack as nu

OBJECTS = 3


def main(folder: Path) -> None:
    """Write a movie of an unpacking into a folder."""
    bag = nu.simulate_bag(seed=1, shape=(64, 72, 96), count=10)
    session = nu.Session(bag.volume, bag.labels, bag.spacing, bag.objects)
    session.view = nu.View(direction=(0.4, 0.5, 0.8), fov=20)
    session.recolor()
    path = nu.movie(
        session,
        folder / "unpacking.mp4",
        count=OBJECTS,
        size=(240, 320),
        fps=12,
        seconds=0.8,
        decorations=("box",),
    )
    # The movie shows a copy: the session itself still has everything packed.
    left = session.unpack(OBJECTS)
    print("leave in this order:", ", ".join(session.objects["name"][i] for i in left))
    print(f"wrote {path}")


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path()
    target.mkdir(parents=True, exist_ok=True)
    main(target)
