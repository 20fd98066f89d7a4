"""The three layers of napari that show a session, their adapter, and what is private of napari."""
