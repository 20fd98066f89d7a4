"""Which objects can leave, in which order, along which path, and where they wait."""

from napari_unpack.unpacking.blocking_graph import BlockingGraph
from napari_unpack.unpacking.direction import AXES, bag_up, named, towards_viewer
from napari_unpack.unpacking.flight_path import Ball, Flight, clearance
from napari_unpack.unpacking.occlusion import ratios, unpackable_ids
from napari_unpack.unpacking.oriented_box import (
    OrientedBox,
    broad_side,
    hull_vertices,
    image_extent,
    oriented_box,
    outline,
)
from napari_unpack.unpacking.queue import Queue
from napari_unpack.unpacking.slots import Slots, arrange, room_for

__all__ = [
    "AXES",
    "Ball",
    "BlockingGraph",
    "Flight",
    "OrientedBox",
    "Queue",
    "Slots",
    "arrange",
    "bag_up",
    "broad_side",
    "clearance",
    "hull_vertices",
    "image_extent",
    "named",
    "oriented_box",
    "outline",
    "ratios",
    "room_for",
    "towards_viewer",
    "unpackable_ids",
]
