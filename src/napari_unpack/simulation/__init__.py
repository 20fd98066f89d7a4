"""Packed bags with ground truth."""

from napari_unpack.simulation.bag import Bag, simulate_bag
from napari_unpack.simulation.projection import ProjectionScanner
from napari_unpack.simulation.scanner import Scanner

__all__ = ["Bag", "ProjectionScanner", "Scanner", "simulate_bag"]
