"""Uniform cubic B-splines: surfaces that are exact at every subpixel, and smooth noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Real = npt.NDArray[np.float64]
Single = npt.NDArray[np.float32]

# Blending a random lattice by a bicubic B-spline leaves this share of its standard deviation.
_NOISE_STD = 151 / 315


@dataclass(frozen=True)
class Grid:
    """Where control points lie: `control[i, j]` belongs to the image position (x0 + j, y0 + i), in pixels."""

    x0: int
    y0: int
    width: int
    height: int

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of control points."""
        return self.height, self.width

    def axes(self) -> tuple[Real, Real]:
        """The positions of the control points, x of shape (1, width) and y of shape (height, 1), px."""
        x = self.x0 + np.arange(self.width, dtype=np.float64)
        y = self.y0 + np.arange(self.height, dtype=np.float64)
        return x[None, :], y[:, None]


@dataclass(frozen=True)
class Surface:
    """A bicubic B-spline f(x, y) with one control point per pixel of `grid`: its normals are continuous."""

    grid: Grid
    control: Real

    def scaled(self, factor: float) -> Surface:
        """The same surface with all values times `factor`."""
        return Surface(self.grid, self.control * factor)

    def along_rows(self, y: Real) -> Real:
        """Control points of the 1-D splines f(., y): shape (len(y), grid.width) for rows `y` in px."""
        at = y - self.grid.y0
        cell = np.clip(np.floor(at).astype(np.intp), 1, self.grid.height - 3)
        weights = basis(at - cell)
        return sum((weights[:, k, None] * self.control[cell - 1 + k] for k in range(4)), np.zeros(1))

    def at(self, x: Real, y: Real) -> Real:
        """Values at x of shape (n, m) in the rows `y` of shape (n,), px."""
        cubics = Cubics.of(self.along_rows(y))
        at = x - self.grid.x0
        cell = np.clip(np.floor(at).astype(np.intp), 1, self.grid.width - 3)
        return cubics.value(cubics.flat(cell), at - cell)

    def at_knots(self) -> Real:
        """Values at the control points' own positions, shape of the grid (its border repeats)."""
        padded = np.pad(self.control, 1, mode="edge")
        rows = (padded[:-2] + 4 * padded[1:-1] + padded[2:]) / 6
        return np.asarray((rows[:, :-2] + 4 * rows[:, 1:-1] + rows[:, 2:]) / 6)


@dataclass(frozen=True)
class Cubics:
    """One cubic per cell and row, `a0 + a1 t + a2 t^2 + a3 t^3` for t in [0, 1]; each array (rows, cells)."""

    a0: Real
    a1: Real
    a2: Real
    a3: Real

    @classmethod
    def of(cls, control: Real) -> Cubics:
        """The cubics of 1-D splines along the last axis; the cell j spans the control points j to j + 1."""
        p0, p1, p2, p3 = (control[:, k : control.shape[1] - 3 + k] for k in range(4))
        return cls(
            (p0 + 4 * p1 + p2) / 6, (p2 - p0) / 2, (p0 - 2 * p1 + p2) / 2, (p3 - p0) / 6 + (p1 - p2) / 2
        )

    def flat(self, cell: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
        """Flat indices for cells counted in control points, shape (rows, m); cell 1 is the first cubic."""
        rows, cells = self.a0.shape
        flat: npt.NDArray[np.intp] = cell - 1 + cells * np.arange(rows)[:, None]
        return flat

    def value(self, flat: npt.NDArray[np.intp], t: Real) -> Real:
        """Values of the cubics at `flat` for the local position t."""
        a0, a1, a2, a3 = self.gather(flat)
        return a0 + t * (a1 + t * (a2 + t * a3))

    def gather(self, flat: npt.NDArray[np.intp]) -> tuple[Real, Real, Real, Real]:
        """The four coefficients at `flat`."""
        a0, a1, a2, a3 = (a.ravel()[flat] for a in (self.a0, self.a1, self.a2, self.a3))
        return a0, a1, a2, a3


def basis(t: Real) -> Real:
    """The four weights of a uniform cubic B-spline at t in [0, 1], shape (n, 4)."""
    return (
        np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3], axis=1) / 6
    )


def smooth_noise(
    rng: np.random.Generator, shape: tuple[int, int], cell: float, stretch: float = 1.0
) -> Single:
    """Noise of zero mean and unit variance, band-limited to features of about `cell` pixels.

    `stretch` makes the features that much longer along x. Shape (H, W), float32.
    """
    at_row = rng.uniform() + np.arange(shape[0]) / max(cell, 1.0)
    at_column = rng.uniform() + np.arange(shape[1]) / max(cell * stretch, 1.0)
    lattice = rng.standard_normal((int(at_column[-1]) + 4, int(at_row[-1]) + 4), dtype=np.float32)
    columns = np.ascontiguousarray(_blend(lattice, at_column).T)
    return _blend(columns, at_row) / np.float32(_NOISE_STD)


def _blend(lattice: Single, at: Real) -> Single:
    """The splines along the first axis of a lattice at the positions `at`: (len(at), lattice.shape[1])."""
    node = np.floor(at).astype(np.intp)
    weights = basis(at - node).astype(np.float32)
    blended = weights[:, 0, None] * lattice[node]
    for k in (1, 2, 3):
        blended += weights[:, k, None] * lattice[node + k]
    return np.asarray(blended, np.float32)
