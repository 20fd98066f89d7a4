"""The GL backend: shaders, textures, passes and visuals on vispy."""
