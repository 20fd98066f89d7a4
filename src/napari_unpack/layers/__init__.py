"""The three stage layers of napari and their vispy adapters."""
