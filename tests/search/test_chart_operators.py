"""Points of the chart, tables there as sums over all their splines, and shapes of surfaces by their tangents."""

import math

import numpy as np
import pytest
import torch
from scipy.interpolate import BSpline

from lensforge.search.constraint_points import (
    ChartOperator,
    ChartPoints,
    RadiusJet,
    constraint_points,
    meridian_points,
)
from lensforge.search.face_fields import draft_sine, least_curvature
from lensforge.surfaces import surface
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.mirror_group import group

GRID = TableGrid(13)
SPLINE = BSpline.basis_element([-2.0, -1.0, 0.0, 1.0, 2.0])


def weights_along(place: float, order: int) -> np.ndarray:
    """Weight of each coefficient along one axis in a derivative at a place."""
    step = 2.0 * 1.02 / 12
    position = (place + 1.02) / step + 1.0  # the first coefficient lies a step before the chart's square
    offsets = position - np.arange(15.0)
    inside = np.abs(offsets) < 2.0
    values = np.where(inside, SPLINE(np.where(inside, offsets, 0.0), nu=order), 0.0) / step**order
    if order == 2:  # what the second derivative lacks, by the fourth difference around the place
        cell = math.floor(position + 1e-9)
        part = position - cell
        lack = (1.0 / 12.0 - part * (1.0 - part) / 2.0) / step**2
        for centre, share in ((cell, 1.0 - part), (cell + 1, part)):
            middle = min(max(centre, 2), 12)
            values[middle - 2 : middle + 3] += lack * share * np.array([1.0, -4.0, 6.0, -4.0, 1.0])
    weights: np.ndarray = values
    return weights


def test_radius_and_derivatives_are_sums_over_the_splines_of_a_table() -> None:
    """At random places, on nodes, in centres of cells, and on the rim, where the difference has no room."""
    chance = np.random.default_rng(0)
    nodes = surface.grid(13)[1:-1, 1:-1].reshape(-1, 2)[::7]
    rim = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [0.6, -0.8]])
    points = np.concatenate([chance.uniform(-1.0, 1.0, (40, 2)), nodes, nodes + 0.5 * GRID.step, rim])
    tables = chance.normal(size=(2, 15, 15))
    jets = ChartOperator.of(GRID, points, True, 0.25).jets(torch.from_numpy(tables))
    for table, jet in zip(tables, jets, strict=True):
        derivatives = torch.cat([jet.rho[None], jet.derivatives]).numpy()
        for row, (dx, dy) in enumerate(((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))):
            wanted = [weights_along(x, dx) @ table @ weights_along(y, dy) for x, y in points]
            np.testing.assert_allclose(derivatives[row], wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())
    alone = ChartOperator.of(GRID, points, False)
    plain, _ = alone.jets(torch.from_numpy(tables))
    assert torch.equal(plain.rho, jets[0].rho) and plain.derivatives.shape == (0, len(points))
    assert (alone.points.spacing, ChartOperator.of(GRID, points, False, 0.25).points.spacing) == (0.0, 0.25)


@pytest.mark.parametrize("symmetry", ["none", "mirror_x", "mirror_y", "rectangle", "square"])
@pytest.mark.parametrize("every", [None, 1, 2, 3])
def test_limits_hold_at_nodes_centres_and_on_the_rim_each_once_among_mirror_images(
    symmetry: str, every: int | None
) -> None:
    axis = [-1.02 + k * GRID.step for k in range(13)]
    nodes = axis[:: every or 1]
    places = [(x, y) for x in nodes for y in nodes]
    if every is None:
        places += [(x + 0.5 * GRID.step, y + 0.5 * GRID.step) for x in axis[:-1] for y in axis[:-1]]
    count = 8 * math.ceil(0.25 * math.pi / GRID.step)
    places = [place for place in places if math.hypot(*place) < 1.0]
    places += [(math.cos(2.0 * math.pi * k / count), math.sin(2.0 * math.pi * k / count)) for k in range(count)]
    points = constraint_points(GRID, symmetry, every_node=every)
    images = [tuple(np.round(image[:2, :2] @ point, 9) + 0.0) for point in points for image in group(symmetry)]
    assert set(images) == {(round(x, 9) + 0.0, round(y, 9) + 0.0) for x, y in places}
    for point in points:
        assert all(tuple(np.round(point, 9)) >= tuple(np.round(image[:2, :2] @ point, 9)) for image in group(symmetry))
    assert len(points) == len(np.unique(np.round(points, 9), axis=0))


def jet_at_random(count: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places, radii, and first and second derivatives by the chart."""
    chance = np.random.default_rng(seed)
    places = chance.uniform(-0.7, 0.7, (count, 2))
    return places, chance.uniform(2.0, 4.0, count), chance.normal(size=(5, count))


def by_tangents(place: np.ndarray, rho: float, derivatives: np.ndarray) -> tuple[float, float, float]:
    """Both principal curvatures, convex positive, and the upward part of the outward normal.

    By differences of the points of space: of the radius only what its derivatives say.
    """
    x, y, xx, xy, yy = derivatives
    step = 1e-3

    def point(a: int, b: int) -> np.ndarray:
        dx, dy = a * step, b * step
        radius = rho + x * dx + y * dy + 0.5 * xx * dx**2 + xy * dx * dy + 0.5 * yy * dy**2
        return np.asarray(radius * surface.to_sphere(place + np.array([dx, dy])))

    def first(one: tuple[int, int], other: tuple[int, int]) -> np.ndarray:
        near = np.asarray((point(*one) - point(*other)) / (2.0 * step))
        far = (point(2 * one[0], 2 * one[1]) - point(2 * other[0], 2 * other[1])) / (4.0 * step)
        return np.asarray((4.0 * near - far) / 3.0)

    def second(a: int, b: int) -> np.ndarray:
        near, far = (
            (point(k * a, k * b) - 2.0 * point(0, 0) + point(-k * a, -k * b)) / (k * step) ** 2 for k in (1, 2)
        )
        return np.asarray((4.0 * near - far) / 3.0)

    r_x = first((1, 0), (-1, 0))
    r_y = first((0, 1), (0, -1))
    r_xx = second(1, 0)
    r_yy = second(0, 1)
    r_xy = (second(1, 1) - second(1, -1)) / 4.0
    normal = np.cross(r_x, r_y)
    normal /= np.linalg.norm(normal)
    if normal @ point(0, 0) < 0.0:
        normal = -normal
    one = np.array([[r_x @ r_x, r_x @ r_y], [r_x @ r_y, r_y @ r_y]])
    two = -np.array([[r_xx @ normal, r_xy @ normal], [r_xy @ normal, r_yy @ normal]])
    low, high = sorted(np.linalg.eigvals(np.linalg.solve(one, two)).real)
    return float(low), float(high), float(normal[2])


def test_curvature_and_draft_are_those_of_the_tangents_in_space() -> None:
    places, rho, derivatives = jet_at_random(40, 2)
    points = ChartPoints.of(places)
    jet = RadiusJet(torch.from_numpy(rho), torch.from_numpy(derivatives))
    outside, inside = (least_curvature(jet, points, air).numpy() for air in (1, -1))
    draft = draft_sine(jet, points).numpy()
    for k, place in enumerate(places):
        low, high, up = by_tangents(place, rho[k], derivatives[:, k])
        assert outside[k] == pytest.approx(low, abs=1e-6 + 1e-6 * abs(low))
        assert inside[k] == pytest.approx(-high, abs=1e-6 + 1e-6 * abs(high))
        assert draft[k] == pytest.approx(up, abs=1e-8)


@pytest.mark.parametrize(("symmetry", "images"), [("none", 1), ("mirror_x", 2), ("square", 8)])
def test_meridians_lie_all_around_the_axis_and_resolve_the_narrowest_function(symmetry: str, images: int) -> None:
    """With all mirror images they are a whole turn of equal steps, a quarter of the function's width at the rim."""
    detail_rad = 0.1
    points = meridian_points(GRID, detail_rad, symmetry)
    turned = np.concatenate([points @ mirror[:2, :2].T for mirror in group(symmetry)])
    rim = turned[np.isclose(np.hypot(*turned.T), 1.0)]
    azimuths = np.unique(np.round(np.arctan2(rim[:, 1], rim[:, 0]) % (2.0 * np.pi), 9))
    steps = np.diff(np.append(azimuths, azimuths[0] + 2.0 * np.pi))
    np.testing.assert_allclose(steps, 2.0 * np.pi / len(steps), atol=1e-8)
    assert steps[0] <= 0.5 * detail_rad
    assert len(group(symmetry)) == images and len(points) < 1.3 * len(np.unique(turned.round(9), axis=0)) / images
