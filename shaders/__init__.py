"""GLSL sources, read by `napari_unpack.rendering.shader_source`."""
