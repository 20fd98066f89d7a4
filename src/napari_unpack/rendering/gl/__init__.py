"""The OpenGL backend: the same images as `rendering.cpu`, by GLSL."""
