"""Float frame buffers that passes draw into, and how to leave no trace of having drawn.

gloo's `FrameBuffer` knows one colour attachment; a tinted image has two, colour and depth, so
the second is attached here with plain GL. Row 0 of a target is row 0 of the image, its top,
as in textures made from arrays.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray
from vispy import gloo
from vispy.gloo.context import GLContext, get_current_canvas

from napari_unpack.rendering.gl.host_memory import HostMemory

# Depth of a pixel that never became opaque, mm; the twin of shaders/lib/no_depth.glsl.
NO_DEPTH = 1.0e30
# A driver keeps a few errors; one that lost its context never runs out of them.
MOST_COMPLAINTS = 8
# Pixels of all sizes kept: 20 bytes each for a tinted image. Three of a large screen's.
MOST_KEPT = 3 * 3840 * 2160

# First column, first row, width and height of a part of an image, pixels.
PixelWindow = tuple[int, int, int, int]


class Target:
    """A frame buffer with float textures of one size, living in the context it was made in.

    Parameters
    ----------
    size : (int, int)
        Height and width, pixels.
    channels : tuple of int
        1 (red) or 4 (RGBA) for each attachment, in the order of gl_FragData.
    smooth : bool
        Whether the RGBA ones are filtered linearly when they are shown enlarged. Never for IDs:
        even at texel centres linear filtering is not exact.

    Raises
    ------
    ValueError
        If a side is longer than the driver's textures are.
    """

    def __init__(
        self, size: tuple[int, int], channels: tuple[int, ...] = (4,), smooth: bool = False
    ) -> None:
        from OpenGL import GL

        self.size = (int(size[0]), int(size[1]))
        current_context().flush_commands()
        most = int(GL.glGetIntegerv(GL.GL_MAX_TEXTURE_SIZE))
        if max(self.size) > most:
            raise ValueError(f"size must be at most {most} pixels a side on this card, got {size}")
        self.channels = channels
        self.textures = tuple(self._texture(n, smooth and n == 4) for n in channels)
        self.framebuffer = gloo.FrameBuffer(color=self.textures[0])
        context = current_context()
        for texture in self.textures:
            context.glir.associate(texture.glir)
        self.framebuffer.activate()
        context.flush_commands()
        # gloo attaches the first colour only; the others are attached with plain GL.
        for i, texture in enumerate(self.textures[1:], start=1):
            GL.glFramebufferTexture2D(
                GL.GL_FRAMEBUFFER,
                GL.GL_COLOR_ATTACHMENT0 + i,
                GL.GL_TEXTURE_2D,
                handle_of(texture),
                0,
            )
        GL.glDrawBuffers(len(channels), [GL.GL_COLOR_ATTACHMENT0 + i for i in range(len(channels))])
        self.framebuffer.deactivate()
        context.flush_commands()

    @contextmanager
    def drawing(self) -> Iterator[None]:
        """Draw into this target inside the `with`; frame buffer and viewport come back after."""
        context = current_context()
        viewport = context.get_viewport()
        self.framebuffer.activate()
        context.set_viewport(0, 0, self.size[1], self.size[0])
        # A pass writes numbers, which blending would mix.
        gloo.set_state(blend=False, depth_test=False, cull_face=False, scissor_test=False)
        try:
            yield
        finally:
            gloo.set_state(scissor_test=False)
            self.framebuffer.deactivate()
            if viewport is not None:
                context.set_viewport(*viewport)
            context.flush_commands()

    def read(self, index: int = 0, memory: HostMemory | None = None) -> NDArray[np.float32]:
        """Return an attachment as an (H, W, channels) ndarray of float32, top row first.

        Parameters
        ----------
        index : int
            Of the attachment.
        memory : HostMemory, optional
            Where the array is to lie; by default in fresh memory.
        """
        from OpenGL import GL

        context = current_context()
        height, width = self.size
        self.framebuffer.activate()
        context.flush_commands()
        GL.glReadBuffer(GL.GL_COLOR_ATTACHMENT0 + index)
        out = (memory or HostMemory()).array((height, width, self.channels[index]))
        kind = GL.GL_RGBA if self.channels[index] == 4 else GL.GL_RED
        GL.glReadPixels(0, 0, width, height, kind, GL.GL_FLOAT, out)
        GL.glReadBuffer(GL.GL_COLOR_ATTACHMENT0)
        self.framebuffer.deactivate()
        context.flush_commands()
        return out

    def delete(self) -> None:
        """Free the frame buffer and its textures."""
        self.framebuffer.delete()
        for texture in self.textures:
            texture.delete()

    def _texture(self, channels: int, smooth: bool) -> gloo.Texture2D:
        return gloo.Texture2D(
            (*self.size, channels),
            format="rgba" if channels == 4 else "red",
            internalformat="rgba32f" if channels == 4 else "r32f",
            interpolation="linear" if smooth else "nearest",
        )


class Targets:
    """A few targets kept by size, so that a resolution used again costs nothing.

    Parameters
    ----------
    channels : tuple of int
        Channels of each colour attachment.
    keep : int
        Sizes whose targets stay.
    smooth : bool
        Whether textures are sampled linearly.

    Attributes
    ----------
    made : int
        How many were ever made.
    """

    def __init__(
        self, channels: tuple[int, ...] = (4,), keep: int = 3, smooth: bool = False
    ) -> None:
        self.made = 0
        self._smooth = smooth
        self._channels = channels
        self._keep = keep
        self._kept: dict[tuple[int, int], Target] = {}

    def get(self, size: tuple[int, int]) -> Target:
        """Return the target of a size, made now or earlier; the oldest beyond `keep` goes."""
        target = self._kept.pop(size, None)
        if target is None:
            target = Target(size, self._channels, self._smooth)
            self.made += 1
        # Put last, since the first is the one thrown away.
        self._kept[size] = target
        while len(self._kept) > self._keep or (len(self._kept) > 1 and self._pixels() > MOST_KEPT):
            self._kept.pop(next(iter(self._kept))).delete()
        return target

    def _pixels(self) -> int:
        return sum(height * width for height, width in self._kept)

    def clear(self) -> None:
        """Free all of them."""
        for target in self._kept.values():
            target.delete()
        self._kept.clear()


def renderer() -> str:
    """Return what the current context's driver calls itself, with its version."""
    from OpenGL import GL

    current_context().flush_commands()
    said = [GL.glGetString(which) for which in (GL.GL_RENDERER, GL.GL_VERSION)]
    return ", ".join(s.decode() if isinstance(s, bytes) else str(s) for s in said)


def forget_complaints() -> None:
    """Drop the GL errors that others have left behind."""
    from vispy.gloo import gl

    current_context().flush_commands()
    for _ in range(MOST_COMPLAINTS):
        if not gl.glGetError():
            return


def finish() -> None:
    """Wait until all is drawn.

    Raises
    ------
    MemoryError
        If the graphics card has not had enough memory.
    RuntimeError
        If the driver complains of anything else.
    """
    from OpenGL import GL
    from vispy.gloo import gl

    current_context().flush_commands()
    gl.glFinish()
    complaint = int(gl.glGetError())
    if complaint == GL.GL_OUT_OF_MEMORY:
        raise MemoryError("it is out of memory")
    if complaint:
        raise RuntimeError(f"GL error {complaint:#06x}")


def handle_of(made: Any) -> int:
    """Return GL's own name of a gloo texture or buffer that has been sent to this context."""
    return int(namespace().get_object(made.id).handle)


def namespace() -> Any:
    """Return what stands for the GL objects of the current context.

    GL objects are kept by it: a context that replaces another has another one.
    """
    return current_context().shared.parser


def current_context() -> GLContext:
    """Return the context to draw in; raise `RuntimeError` if no canvas is current.

    Raises
    ------
    RuntimeError
        If no GL context is current.
    """
    canvas = get_current_canvas()
    if canvas is None:
        raise RuntimeError("no GL context is current: draw inside a canvas, or in offscreen.use()")
    return canvas.context
