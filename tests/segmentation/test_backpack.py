"""What a person sees in a real packed rucksack is one object each, apart from its cloth."""

import numpy as np
from real_scans import real_scan
from scipy.ndimage import label

from napari_unpack.segmentation import segment

# Drawn by hand on the scan: where each thing lies, and a density that only its hull reaches there.
THINGS = {
    "can at one side": (np.s_[46:112, 121:164, 11:56], 1200),
    "can at the other": (np.s_[29:138, 97:152, 195:236], 1000),
    "tube on top": (np.s_[0:81, 45:91, 107:147], 1200),
    "metal box": (np.s_[85:135, 143:185, 138:204], 2000),
    "coil of cable": (np.s_[52:147, 84:193, 60:136], 1500),
    "rod": (np.s_[85:101, 47:117, 133:163], 2000),
}
# The cable goes on beside the can, which is denser.
WHOLE = {thing: window for thing, (window, _) in THINGS.items()}
WHOLE["coil of cable"] = np.s_[52:147, 84:193, 25:136]

BESIDE = np.s_[52:147, 84:193, 25:62]
"""Where its strands and the can are all that is as dense as they."""


def hull(density, thing):
    """Return the largest dense piece in a thing's window."""
    window, level = THINGS[thing]
    pieces, _ = label(density[window] > level, np.ones((3, 3, 3)))
    return pieces == 1 + np.bincount(pieces.reshape(-1))[1:].argmax()


def shares_of(density, labels, thing):
    """Return how many voxels of a thing's hull each object has."""
    return np.bincount(labels[THINGS[thing][0]][hull(density, thing)])


def test_each_thing_of_the_rucksack_is_one_object_apart_from_the_others():
    scan = real_scan("backpack")
    density = scan["volume"]
    # No confidence is asked for: measuring it takes as long as several of the other steps.
    spacing = tuple(float(s) for s in scan["spacing"])
    labels = segment(density, spacing, oracle=lambda _: 1.0).labels

    names = {}
    for thing in THINGS:
        shares = shares_of(density, labels, thing)
        names[thing] = 1 + int(shares[1:].argmax())
        assert shares[1:].max() > 0.85 * shares.sum(), f"{thing} is in pieces"
        own = labels == names[thing]
        inside = np.count_nonzero(own[WHOLE[thing]])
        assert inside > 0.9 * np.count_nonzero(own), f"{thing} is one with what is around it"
    assert len(set(names.values())) == len(THINGS), f"joined: {names}"

    strands = labels[BESIDE][(density[BESIDE] > 1500) & (density[BESIDE] < 2600)]
    others = strands[strands != names["can at one side"]]
    assert (others == names["coil of cable"]).mean() > 0.9, "strands beside the can are another's"

    sizes = np.bincount(labels.reshape(-1))
    means = np.bincount(labels.reshape(-1), density.reshape(-1)) / np.maximum(sizes, 1)
    buttons = (sizes > 80) & (sizes < 250) & (means > 1500)
    assert np.count_nonzero(buttons[1:]) >= 12, "buttons and eyelets went with the cloth"
