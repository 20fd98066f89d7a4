from .blocking_graph import BlockingGraph
from .direction import AXES, bag_up, named, towards_viewer
from .flight_path import Ball, Flight, clearance
from .occlusion import ratios, unpackable_ids
from .oriented_box import (
    OrientedBox,
    broad_side,
    hull_vertices,
    image_extent,
    oriented_box,
    outline,
)
from .queue import Queue
from .slots import Slots, arrange, room_for

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
