"""vispy's transforms as the (4, 4) column-vector matrices the rest of the package speaks."""

from __future__ import annotations

from typing import Any

import numpy as np
from vispy.visuals.transforms import ChainTransform, MatrixTransform, NullTransform, STTransform
from vispy.visuals.transforms.base_transform import InverseTransform

from napari_unpack.geometry.axes import Matrix


def matrix_of(transform: Any) -> Matrix:
    """Return the (4, 4) matrix, for column vectors, of a linear or projective vispy transform.

    It may be a matrix, a scale and translation, nothing, or a chain of these: all that lies between
    a 3D scene and the screen. vispy's own matrices act on rows.

    Raises
    ------
    TypeError
        If a link of the chain is another kind, such as a logarithm.

    Notes
    -----
    Not made by mapping points: `STTransform.map` ignores w, unlike its own shader.
    """
    if isinstance(transform, ChainTransform):
        product = np.eye(4)
        for link in transform.transforms:
            product = product @ matrix_of(link)
        return product
    if isinstance(transform, InverseTransform):
        inverse: Matrix = np.linalg.inv(matrix_of(transform.inverse)).astype(np.float64)
        return inverse
    if isinstance(transform, NullTransform):
        return np.eye(4)
    if isinstance(transform, STTransform):
        # Several times as quick as its own as_matrix(), and asked at every draw.
        scaled = np.diag(np.asarray(transform.scale, dtype=np.float64))
        scaled[3, 3] = 1.0
        scaled[:3, 3] = transform.translate[:3]
        return scaled
    if isinstance(transform, MatrixTransform):
        return np.asarray(transform.matrix, dtype=np.float64).T.copy()
    raise TypeError(f"transform must be made of matrices and scales, got {transform!r}")
