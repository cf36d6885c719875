"""A slow, scalar ray tracer for the tests: it marches through space and shares no code with the package's."""

import math

import numpy as np


def bspline(t):
    t = abs(t)
    if t < 1:
        return 2 / 3 - t * t + t**3 / 2
    return (2 - t) ** 3 / 6 if t < 2 else 0.0


def value(surface, x, y):
    u, v = x - surface.grid.x0, y - surface.grid.y0
    i, j = math.floor(v), math.floor(u)
    total = 0.0
    for k in range(i - 1, i + 3):
        for m in range(j - 1, j + 3):
            total += bspline(v - k) * bspline(u - m) * surface.control[k, m]
    return total


class Space:
    """A scene as a test of points: on which side of each sheet they lie, whether inside the instrument."""

    def __init__(self, scene):
        self.scene, self.rig = scene, scene.rig
        self.cx, self.cy = (self.rig.width - 1) / 2, (self.rig.height - 1) / 2

    def ray(self, x, y, side):
        """Points on the ray of the left (+1) or right (-1) camera through (x, y), by depth in mm."""
        start = -side * self.rig.baseline_mm / 2
        slope = (x - self.cx) / self.rig.focal_px, (y - self.cy) / self.rig.focal_px
        return lambda z: np.array([start + z * slope[0], z * slope[1], z])

    def project(self, point, camera_x):
        f = self.rig.focal_px
        return f * (point[0] - camera_x) / point[2] + self.cx, f * point[1] / point[2] + self.cy

    def in_front(self, point):
        """How far the point is in front of each sheet, px of disparity, and the sheets' rims there."""
        x, y = self.project(point, 0.0)
        disparity = self.rig.focal_px * self.rig.baseline_mm / point[2]
        gaps = [disparity - value(layer.disparity, x, y) for layer in self.scene.layers]
        rims = [0.0 if layer.rim is None else value(layer.rim, x, y) for layer in self.scene.layers]
        return gaps, rims

    def outside_shaft(self, point):
        shaft = self.scene.shaft
        if shaft is None:
            return math.inf
        along = max(float(np.dot(point - shaft.tip, shaft.axis)), 0.0)
        return float(np.linalg.norm(point - shaft.tip - along * shaft.axis)) - shaft.radius

    def first_depth(self, ray, nearest, farthest, step=0.1):
        """Depth in mm of the first surface from disparity `nearest` to `farthest`, px; None if none."""
        scale = self.rig.focal_px * self.rig.baseline_mm
        before, gaps_before = nearest, self.in_front(ray(scale / nearest))[0]
        while before > farthest:
            now = max(before - step, farthest)
            gaps = self.in_front(ray(scale / now))[0]
            for n, (a, b) in enumerate(zip(gaps_before, gaps, strict=True)):
                if (a > 0) != (b > 0):
                    found = bisect(lambda d, n=n: self.in_front(ray(scale / d))[0][n], before, now)
                    if self.in_front(ray(scale / found))[1][n] >= 0:
                        return scale / found
            if self.outside_shaft(ray(scale / now)) <= 0:
                return scale / bisect(lambda d: self.outside_shaft(ray(scale / d)), before, now)
            before, gaps_before = now, gaps
        return None


def bisect(function, a, b):
    positive = function(a) > 0
    for _ in range(45):
        middle = (a + b) / 2
        if (function(middle) > 0) == positive:
            a = middle
        else:
            b = middle
    return (a + b) / 2
