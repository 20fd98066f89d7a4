"""Packed bags with ground truth."""

from napari_unpack.simulation.bag import Bag, simulate_bag
from napari_unpack.simulation.scanner import Scanner
from napari_unpack.simulation.truth import contacts, removable

__all__ = ["Bag", "Scanner", "contacts", "removable", "simulate_bag"]
