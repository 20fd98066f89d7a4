"""Views and cameras: where one looks from, which way is up, how much is seen.

`View` is what a person asks for and may leave things open; `Camera` has nothing left open and
turns into rays (`geometry.rays`) and into pivot space, where sprites live.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from napari_unpack.geometry.axes import (
    Matrix,
    Vector,
    fixed,
    number,
    transform_points,
    triple,
    unit,
)

# Up in a CT scan as scanners lay it out: rows (y) grow downwards, towards the table.
GRAVITY_UP: tuple[float, float, float] = (0.0, -1.0, 0.0)

# Direction of looking into an open bag that lies on a table: a good first view.
FROM_ABOVE: tuple[float, float, float] = (0.5, 0.75, 0.3)

# Of the eye's distance: what is nearer to the eye is not seen.
NEAREST = 1e-6

# Of the eye's distance: points from here on have no place in the image.
BEFORE_EYE = 0.98

# Beyond this cosine between looking and gravity, up in the image is -z unless asked otherwise.
STEEPEST = 0.97


@dataclass(frozen=True, init=False)
class View:
    """What a person wants to see; whatever is None is chosen from the volume.

    It holds plain tuples and numbers, whatever arrays they were taken from.

    Parameters
    ----------
    direction : (3,) array_like
        Direction of looking, world (z, y, x). Need not be of unit length.
    up : (3,) array_like, optional
        What is up in the image. By default -y, or -z when looking nearly along y.
    center : (3,) array_like, optional
        World point in the middle of the image, mm. By default the middle of the volume.
    height : float, optional
        Visible height at the centre, mm. By default the diameter of the volume's bounding
        sphere, enlarged in perspective so that the sphere just touches the frame.
    fov : float
        Vertical field of view in degrees, 0 (orthographic) to below 170.

    Raises
    ------
    TypeError
        If `height` or `fov` is no number.
    ValueError
        If there is no such view.
    """

    direction: tuple[float, float, float]
    up: tuple[float, float, float] | None
    center: tuple[float, float, float] | None
    height: float | None
    fov: float

    # Written out: what is given may be lists and arrays, what is held is plain.
    def __init__(
        self,
        direction: ArrayLike = (0.0, 0.0, 1.0),
        up: ArrayLike | None = None,
        center: ArrayLike | None = None,
        height: float | None = None,
        fov: float = 0.0,
    ) -> None:
        looking = unit(direction, "direction of looking")
        # Nearly parallel vectors leave up in the image to rounding.
        if up is not None and np.linalg.norm(np.cross(looking, unit(up, "up"))) < 1e-6:
            raise ValueError(
                f"up must not be parallel to direction, got up={up!r}, direction={direction!r}"
            )
        if center is not None:
            middle = np.asarray(center, dtype=np.float64)
            if middle.shape != (3,) or not np.isfinite(middle).all():
                raise ValueError(
                    f"center must be three finite numbers of mm (z, y, x), got {center!r}"
                )
        angle = number(fov, "fov")
        # Towards 180 degrees the eye comes to stand in the plane it looks at.
        if not 0.0 <= angle < 170.0:
            raise ValueError(f"fov must be in [0, 170) degrees, got {fov!r}")
        mm = None if height is None else number(height, "height")
        if mm is not None and not 0.0 < mm < np.inf:
            raise ValueError(f"height must be a positive number of mm, got {height!r}")
        vectors = {"direction": direction, "up": up, "center": center}
        plain = {k: None if v is None else triple(np.asarray(v)) for k, v in vectors.items()}
        for name, value in {**plain, "height": mm, "fov": angle}.items():
            object.__setattr__(self, name, value)

    def camera(
        self, shape: tuple[int, ...], spacing: ArrayLike, stretch: Matrix | None = None
    ) -> Camera:
        """Settle everything left open for a volume.

        Parameters
        ----------
        shape : (3,) tuple of int
            Voxels along z, y, x.
        spacing : (3,) array_like, mm z y x
        stretch : (3, 3) ndarray of float64, optional
            The camera's; by default none.
        """
        size = np.asarray(shape, dtype=np.float64) * np.asarray(spacing, dtype=np.float64)
        middle = (size - np.asarray(spacing, dtype=np.float64)) / 2
        radius = float(np.linalg.norm(size)) / 2
        # Sphere of radius r at distance d fills half-angle asin(r/d); with d = h / (2 tan a)
        # the frame touches it where sin a = r/d, so h = 2 r / cos a.
        height = self.height or 2 * radius / np.cos(np.radians(self.fov) / 2)
        center = middle if self.center is None else np.asarray(self.center, dtype=np.float64)
        return Camera.looking(self.direction, self.up, center, float(height), self.fov, stretch)

    def orthographic(self) -> View:
        """Return the same view without perspective."""
        return replace(self, fov=0.0)


@dataclass(frozen=True, eq=False)
class Camera:
    """A view with nothing left open, in world mm (z, y, x).

    Parameters
    ----------
    rotation : (3, 3) ndarray of float64
        Rows are the pivot-space axes in (stretched) world coordinates: towards the viewer, down
        the image, right in the image. A proper rotation; the identity is napari's default
        view.
    center : (3,) ndarray of float64
        World point at the origin of pivot space, mm.
    height : float
        Visible height at the centre, mm.
    fov : float
        Vertical field of view, degrees; 0 is orthographic.
    stretch : (3, 3) ndarray of float64
        How the world is stretched, sheared or mirrored before it is turned and looked at: what
        the affine of a napari layer does besides turning. Symmetric, of determinant 1 or -1;
        the identity for nearly every bag, minus the identity for one that is mirrored.

    Notes
    -----
    Every affine is a length times `rotation @ stretch` (polar decomposition). A mirror is taken
    as a reflection in a point, which commutes with all turns, so that turns stay proper.
    Objects are rigid in the stretched world, where they stand as napari draws them.
    """

    rotation: Matrix
    center: Vector
    height: float
    fov: float = 0.0
    stretch: Matrix = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        """Keep arrays that nobody can write to, and plain numbers: sessions hand cameras out."""
        for name in ("rotation", "center", "stretch"):
            object.__setattr__(self, name, fixed(getattr(self, name)))
        object.__setattr__(self, "height", float(self.height))
        object.__setattr__(self, "fov", float(self.fov))

    @classmethod
    def looking(
        cls,
        direction: ArrayLike,
        up: ArrayLike | None,
        center: ArrayLike,
        height: float,
        fov: float = 0.0,
        stretch: Matrix | None = None,
    ) -> Camera:
        """Make a camera from a direction of looking and an up vector.

        Parameters
        ----------
        direction, up : (3,) array_like
            World; without `up`, gravity decides.
        center : (3,) array_like
            What is looked at, world mm.
        height : float
            Visible height at the centre, mm.
        fov : float
            Vertical field of view, degrees; 0 is parallel.
        stretch : (3, 3) ndarray, optional
            The camera's fourth part; by default the identity.
        """
        towards = -unit(direction, "direction")
        wanted = np.asarray(GRAVITY_UP if up is None else up, dtype=np.float64)
        # Looking along gravity, -y is no direction in the image: -z stands in for it.
        if up is None and abs(towards @ wanted) > STEEPEST:
            wanted = np.array([-1.0, 0.0, 0.0])
        if stretch is None:
            stretch = np.eye(3)
        else:
            # Pivot space is stretched as napari draws the bag, so both directions are taken there.
            towards, wanted = unit(stretch @ towards), stretch @ wanted
        # Gram-Schmidt: up as far as it lies in the image plane.
        down = -(wanted - towards * (wanted @ towards))
        down /= np.linalg.norm(down)
        rotation = np.stack([towards, down, np.cross(towards, down)])
        middle = np.asarray(center, dtype=np.float64)
        return cls(rotation, middle, float(height), float(fov), stretch)

    @property
    def linear(self) -> Matrix:
        """(3, 3) map of vectors from world to pivot space: the stretch, then the turn."""
        linear: Matrix = self.rotation @ self.stretch
        return linear

    def in_world(self, pivot_vectors: ArrayLike) -> NDArray[np.float64]:
        """Return the world vectors that (..., 3) vectors of pivot space are."""
        # A rotation's inverse is its transpose: rows times it are columns times that.
        vectors = np.asarray(pivot_vectors, dtype=np.float64) @ self.rotation
        return vectors @ np.linalg.inv(self.stretch)

    @property
    def direction(self) -> Vector:
        """Direction of looking, (3,) unit vector, world."""
        return unit(self.in_world((-1.0, 0.0, 0.0)))

    @property
    def up(self) -> Vector:
        """What is up in the image, (3,) unit vector, world."""
        return unit(self.in_world((0.0, -1.0, 0.0)))

    @property
    def right(self) -> Vector:
        """What is right in the image, (3,) unit vector, world."""
        return unit(self.in_world((0.0, 0.0, 1.0)))

    @property
    def distance(self) -> float:
        """Distance of the eye from the centre, mm; infinite when orthographic."""
        if self.fov == 0.0:
            return float("inf")
        return self.height / (2 * float(np.tan(np.radians(self.fov) / 2)))

    def orthographic(self) -> Camera:
        """Return the same camera without perspective."""
        return replace(self, fov=0.0)

    def flattened(self, towards: float, flatness: float = 1.0) -> Camera | None:
        """Return the camera with less perspective under which a plane of pivot space stays.

        Parameters
        ----------
        towards : float
            Of the plane, mm towards the viewer from the centre.
        flatness : float
            0 gives this camera, 1 an orthographic one.

        Returns
        -------
        Camera or None
            None where the plane is at the eye or behind it, and so not seen.

        Notes
        -----
        This is how sprites are projected: their images are orthographic and stand in such a
        plane. Pivot space is the same for both cameras, as the eye only draws back.
        """
        nearness = 1.0 - towards / self.distance
        if nearness <= NEAREST:
            return None
        if not flatness or np.isinf(self.distance):
            return self
        # The inverse of the eye's distance, which has no infinity.
        closeness = (1.0 - flatness) / self.distance
        height = self.height * nearness / (1.0 - towards * closeness)
        fov = 2.0 * np.degrees(np.arctan(height * closeness / 2.0))
        return replace(self, height=float(height), fov=float(fov))

    def pivot_from_world(self) -> Matrix:
        """Return the (4, 4) map from world mm to pivot space (towards, down, right)."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.linear
        matrix[:3, 3] = -matrix[:3, :3] @ self.center
        return matrix

    def pixels(self, pivot_points: ArrayLike, size: tuple[int, int]) -> NDArray[np.float64]:
        """Project pivot-space points to (..., 2) pixels: row 0 at the top, centres at integers.

        Parameters
        ----------
        pivot_points : (..., 3) array_like
            Points in pivot space, mm.
        size : (int, int)
            Height and width of the image in pixels.
        """
        p = np.asarray(pivot_points, dtype=np.float64)
        # The distance is infinite without perspective, which leaves the scale as it is.
        scale = size[0] / self.height / (1.0 - p[..., 0] / self.distance)
        middle = (np.asarray(size, dtype=np.float64) - 1) / 2
        return middle + p[..., 1:] * scale[..., None]

    def behind_eye(self, pivot_points: ArrayLike) -> bool:
        """Return whether one of (..., 3) pivot-space points is behind the eye, or just before it.

        Behind it a point has no place in the image; just before it pixels are millions apart.
        """
        towards = np.asarray(pivot_points, dtype=np.float64)[..., 0]
        return bool((towards >= BEFORE_EYE * self.distance).any())

    def ray(self, pixel: ArrayLike, size: tuple[int, int]) -> tuple[Vector, Vector]:
        """Return a pixel's ray in pivot space: its point of the pivot plane, its way from the eye.

        Parameters
        ----------
        pixel : (2,) array_like
            Row and column.
        size : (int, int)
            Height and width of the image in pixels.

        Returns
        -------
        point, way : (3,) ndarray of float64
            mm. One mm of the way leads one mm away from the viewer.
        """
        middle = (np.asarray(size, dtype=np.float64) - 1) / 2
        down, right = (np.asarray(pixel, dtype=np.float64) - middle) * self.height / size[0]
        # The distance is infinite without perspective: all ways are parallel then.
        way = np.array([-1.0, down / self.distance, right / self.distance])
        return np.array([0.0, down, right]), way

    def project(self, world_points: ArrayLike, size: tuple[int, int]) -> NDArray[np.float64]:
        """Project world points to pixels (row, column); see `pixels`.

        Parameters
        ----------
        world_points : (..., 3) array_like
            World mm.
        size : (int, int)
            Height and width of the image, pixels.
        """
        return self.pixels(transform_points(self.pivot_from_world(), world_points), size)
