"""Packed bags with ground truth."""

from napari_unpack.simulation.bag import Bag, simulate_bag
from napari_unpack.simulation.projection import ProjectionScanner
from napari_unpack.simulation.scanner import Scanner
from napari_unpack.simulation.truth import contacts, removable

__all__ = ["Bag", "ProjectionScanner", "Scanner", "contacts", "removable", "simulate_bag"]
