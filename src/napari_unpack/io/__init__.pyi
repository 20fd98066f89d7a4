from .images import save_png
from .interactive_page import save_interactive_page
from .movies import movie
from .report import save_measurements_csv, save_objects_csv, save_objects_page
from .scan import Scan
from .sessions import open_session, save_session
from .surfaces import save_surfaces
from .volumes import load_labels, load_volume, save_scan

__all__ = [
    "Scan",
    "load_labels",
    "load_volume",
    "movie",
    "open_session",
    "save_interactive_page",
    "save_measurements_csv",
    "save_objects_csv",
    "save_objects_page",
    "save_png",
    "save_scan",
    "save_session",
    "save_surfaces",
]
