"""Shows one session in one napari viewer."""
