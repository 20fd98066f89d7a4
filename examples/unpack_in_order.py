"""Tell which objects are unpackable now, and in which order all of them can leave.

Run `python unpack_in_order.py [FOLDER]`. A small bag is simulated; its labels are known. Objects
leave upwards, as out of an open bag that lies on a table. Prints who is unpackable at first, then
one line for each step. Objects that hold each other leave together. Where nothing is unpackable,
the least occluded object leaves, and its occlusion ratio is printed. Writes order.csv.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import napari_unpack as nu


def main(folder: Path) -> None:
    """Unpack a bag object by object and write the order into a folder."""
    bag = nu.simulate_bag(seed=1, shape=(64, 72, 96), count=10)
    session = nu.Session(bag.volume, bag.labels, bag.spacing, bag.objects)
    session.direction = "up"
    names = session.objects["name"]
    print("Unpackable now:", ", ".join(names[i] for i in session.unpackable()))
    while session.unpack(1):
        entry = session.log[-1]
        forced = f" (least occluded: {entry.ratio:.1%} hidden)" if entry.ratio > 0 else ""
        print(f"{len(session.log)}. {' with '.join(names[i] for i in entry.ids)}{forced}")
    with (folder / "order.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["step", "id", "name", "occlusion_ratio"])
        for step, entry in enumerate(session.log, 1):
            table.writerows([step, i, names[i], entry.ratio] for i in entry.ids)


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path()
    target.mkdir(parents=True, exist_ok=True)
    main(target)
