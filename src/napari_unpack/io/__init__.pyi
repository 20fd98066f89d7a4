from .films import movie
from .images import save_png
from .pages import save_objects_page
from .scan import Scan
from .sessions import open_session, save_session
from .tables import save_objects_csv
from .volumes import load_labels, load_volume, save_scan

__all__ = [
    "Scan",
    "load_labels",
    "load_volume",
    "movie",
    "open_session",
    "save_objects_csv",
    "save_objects_page",
    "save_png",
    "save_scan",
    "save_session",
]
