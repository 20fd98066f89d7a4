"""GLSL sources, read by `napari_unpack.rendering.gl.programs`."""
