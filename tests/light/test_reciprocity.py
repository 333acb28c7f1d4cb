"""Light takes the same way back: from the receiver through the lens to where it started, with the same losses.

The way back is walked here: from outside of the lens, where neither tracer ever starts.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch
from exact_surface import ExactSurface
from landed import plane_at, trace_exact, trace_tables
from scenes import random_surface, table_of
from scipy.interpolate import NdBSpline

from lensforge.light.table_trace import Scene
from lensforge.optics import dielectric
from lensforge.optics.media import Media, Medium
from lensforge.scene.exit_rays import ExitRays
from lensforge.sources.build_source import SquareEmitter
from lensforge.surfaces import surface as chart
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.surface import Surface

N = 1.4936
FAR = 30.0
LENS = random_surface(1, 0.8, 0.01, (9, 25)), random_surface(2, 2.45, 0.01, (9, 25))
GRID = TableGrid(48)


class Tabulated(Surface):
    """A table's surface, evaluated by scipy."""

    def __init__(self, table: np.ndarray) -> None:
        knots = GRID.origin + GRID.step * (np.arange(GRID.side + 4) - 2)
        self._spline = NdBSpline((knots, knots), table, 3)

    def radius(self, directions: np.ndarray) -> np.ndarray:
        return self._spline(chart.to_chart(directions))

    def gradient(self, directions: np.ndarray) -> np.ndarray:
        at = chart.to_chart(directions)
        rising = directions + np.array([0.0, 0.0, 1.0])
        total = np.zeros_like(directions)
        for axis, order in enumerate(((1, 0), (0, 1))):
            towards = np.eye(3)[axis] - at[:, axis, None] * rising
            total += self._spline(at, nu=order)[:, None] * towards / rising[:, 2:]
        return total


def _enter(surface: Surface, points: np.ndarray, directions: np.ndarray, reach: float) -> np.ndarray:
    """The first points below the surface, seen from above it: a march, then bisection."""

    def inside(t: np.ndarray) -> np.ndarray:
        at = points + t[:, None] * directions
        distance = np.linalg.norm(at, axis=1)
        return (at[:, 2] > -0.1) & (distance < surface.radius(at / distance[:, None]))

    low = np.zeros(len(points))
    high = np.full(len(points), np.inf)
    entered = np.zeros(len(points), dtype=bool)
    for t in np.linspace(1e-3, reach, 600):
        here = inside(np.full(len(points), t)) & ~entered
        high[here] = t
        entered |= here
        low[~entered] = t
    assert entered.all()
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = inside(middle)
        low = np.where(below, low, middle)
        high = np.where(below, middle, high)
    return points + low[:, None] * directions


def _back(lens: tuple[Surface, Surface], hits: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, ...]:
    """Points in the plane z = 0, directions there, and the transmitted share, of rays from the receiver."""
    inner, outer = lens
    t = (hits[:, 2] - 4.0) / -directions[:, 2]
    points = hits + t[:, None] * directions
    fields = dielectric.unpolarised_fields(torch.from_numpy(directions))
    for surface, ratio, reach in ((outer, 1.0 / N, 8.0), (inner, N, 5.0)):
        points = _enter(surface, points, directions, reach)
        normals = -surface.normal(points / np.linalg.norm(points, axis=1, keepdims=True))
        d = torch.from_numpy(directions)
        n = torch.from_numpy(normals)
        behind = dielectric.refract(d, n, ratio)
        transmittances = dielectric.fresnel_transmittances((d * n).sum(dim=1), ratio)
        fields = dielectric.fields_behind(fields, d, behind, n, dielectric.passing_amplitudes(transmittances, ratio))
        directions = behind.numpy()
    carried = 0.5 * (fields**2).sum(dim=(1, 2)).numpy()
    return points - points[:, 2:] / directions[:, 2:] * directions, directions, carried


def _forth(exits: ExitRays) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Which rays arrive; their hits, directions behind the lens, and transmitted shares."""
    far = plane_at(FAR).land_by_arrays(exits)
    kept = (far.landed & (far.hits.abs() < 30.0).all(dim=1)).numpy()
    hits = np.column_stack([far.hits.numpy(), np.full(len(kept), FAR)])[kept]
    return kept, hits, exits.directions.numpy()[kept], exits.flux.numpy()[kept]


@pytest.mark.parametrize("tracer", ["fused", "reference"])
def test_a_ray_sent_back_arrives_where_it_started(tracer: str) -> None:
    rays = SquareEmitter(0.6).sample(200, 3)
    if tracer == "fused":
        tables = [table_of(s, GRID) for s in LENS]
        surfaces: tuple[Surface, Surface] = tuple(Tabulated(table.numpy()) for table in tables)
        kept, hits, out, carried = _forth(trace_tables(tables, Scene(Media(Medium(N)), GRID), rays))
    else:
        exact = [replace(ExactSurface.of(s).face(), steps=64, bisections=50) for s in LENS]
        surfaces = LENS
        kept, hits, out, carried = _forth(trace_exact(*exact, Media(Medium(N)), rays))
    assert kept.sum() > 100
    points, directions, share = _back(surfaces, hits, -out)
    assert np.abs(points - rays.origins[kept]).max() < 1e-12
    assert np.abs(directions + rays.directions[kept]).max() < 1e-12
    assert np.allclose(share * rays.flux[kept], carried, rtol=1e-12)
