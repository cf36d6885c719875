"""The instrument: a cylinder with a rounded tip, met by rays in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereomend.phantom.spline import Real


@dataclass(frozen=True)
class Shaft:
    """A cylinder of `radius` around the line from `tip`, the centre of its rounded end, along `axis`.

    Millimetres, origin in the middle of the baseline, z away from the cameras; `axis` has unit length and
    leads out of the picture, where the cylinder goes on.
    """

    tip: Real
    axis: Real
    radius: float

    def depth_along(self, origin: Real, direction: Real) -> Real:
        """Depth in mm at which rays with directions (..., 3) of unit z first meet it, inf where not."""
        return np.minimum(self._cylinder(origin, direction), self._ball(origin, direction))

    def _cylinder(self, origin: Real, direction: Real) -> Real:
        """Depth of the first meeting with the side, beyond the tip's centre."""
        offset = origin - self.tip
        along, start = direction @ self.axis, float(offset @ self.axis)
        across = direction - along[..., None] * self.axis
        from_axis = offset - start * self.axis
        depth = _first_root(
            np.einsum("...i,...i", across, across),
            across @ from_axis,
            float(from_axis @ from_axis) - self.radius**2,
        )
        return np.where(start + np.where(np.isfinite(depth), depth, 0) * along >= 0, depth, np.inf)

    def _ball(self, origin: Real, direction: Real) -> Real:
        """Depth of the first meeting with the sphere around the tip."""
        offset = origin - self.tip
        square = np.einsum("...i,...i", direction, direction)
        return _first_root(square, direction @ offset, float(offset @ offset) - self.radius**2)

    def axial(self, points: Real) -> Real:
        """Place of points (..., 3) along the axis, mm; negative in the rounded end."""
        return np.asarray((points - self.tip) @ self.axis)

    def normals(self, points: Real) -> Real:
        """Unit normals at points (..., 3) on the surface."""
        along = np.maximum(self.axial(points), 0)
        outward = points - self.tip - along[..., None] * self.axis
        return np.asarray(outward / np.linalg.norm(outward, axis=-1, keepdims=True))


def _first_root(a: Real, half_b: Real, c: float) -> Real:
    """The smaller root of a z^2 + 2 half_b z + c = 0 if it is real and positive, else inf."""
    square = half_b**2 - a * c
    root = (-half_b - np.sqrt(np.maximum(square, 0))) / np.maximum(a, 1e-300)
    return np.where((square >= 0) & (root > 0), root, np.inf)
