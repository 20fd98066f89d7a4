"""Train the confidence on labelled volumes of your own and use it in a segmentation.

Run `python train_confidence.py [FOLDER]`. Small simulated bags stand for your labelled volumes;
anything with `.volume`, `.labels` and `.spacing` will do. Two bags only show the way: take as many
as you have. Writes oracle.npz. Prints the confidence that the oracle gives to the objects found in
a bag that it has not seen, beside the confidence that ships with the package.
"""

from __future__ import annotations

import sys
from pathlib import Path

import napari_unpack as nu


def main(folder: Path) -> None:
    """Train an oracle, write it into a folder, load it again and ask it."""
    bags = (nu.simulate_bag(seed=seed, shape=(48, 56, 80), count=9) for seed in (10, 11))
    # One line that is written over: a bar that moves all the time.
    oracle = nu.train(bags, progress=lambda done, text: print(f"{done:4.0%}  {text}", end="\r"))
    print()
    path = folder / "oracle.npz"
    oracle.save(path)
    unseen = nu.simulate_bag(seed=6, shape=(64, 72, 96), count=10)
    shipped = nu.segment(unseen.volume, unseen.spacing).objects
    own = nu.segment(unseen.volume, unseen.spacing, oracle=nu.Oracle.load(path)).objects
    for object_id in own.index:
        print(
            f"object {object_id}: confidence {own['confidence'][object_id]:.2f}, "
            f"as shipped {shipped['confidence'][object_id]:.2f}"
        )
    print(f"wrote {path}")


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path()
    target.mkdir(parents=True, exist_ok=True)
    main(target)
