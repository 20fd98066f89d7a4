"""A simulated packed bag as napari sample data."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Progress = Callable[[float, str], None]
LayerData = tuple[Any, dict[str, Any], str]
SHAPE = (96, 120, 144)
COUNT = 18


def packed_bag(seed: int = 4, progress: Progress | None = None) -> list[LayerData]:
    """Simulate a small bag and its true objects.

    Parameters
    ----------
    seed : int
        Which bag.
    progress : callable, optional
        Takes (fraction in [0, 1], text); raises to cancel.

    Returns
    -------
    list of (array, dict, str)
        The labels of the true objects, not shown, and above them the density volume, which
        napari therefore makes the active layer: the one to segment.
    """
    from napari_unpack.simulation import simulate_bag

    bag = simulate_bag(seed=seed, shape=SHAPE, count=COUNT, progress=progress)
    placed = {"scale": tuple(float(s) for s in bag.spacing), "units": ("mm",) * 3}
    return [
        (
            bag.labels,
            {
                "name": "Packed bag, true objects",
                "visible": False,
                "features": {"index": list(bag.objects.index), "name": list(bag.objects["name"])},
                **placed,
            },
            "labels",
        ),
        (
            bag.volume,
            {
                "name": "Packed bag",
                "colormap": "gray",
                "contrast_limits": (0, 3000),
                "rendering": "attenuated_mip",
                **placed,
            },
            "image",
        ),
    ]
