"""A face through the points of a file.

The face is a spline over the chart in least squares, its error taken at points left out. Between points and beyond the
last of them the spline bends as little as it can (P-splines: P. H. C. Eilers and B. D. Marx, Statistical Science 11,
89, 1996).
"""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.surfaces.chart_spline import DEGREE, HALF_WIDTH, ChartSpline, detail_of
from lensforge.surfaces.imported_face import GivenFace, place_of
from lensforge.surfaces.point_files import Coordinates, read_cloud
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import to_chart

_LEFT_OUT = 10  # one point of so many, to measure the error between points
# Cells of the spline across the chart.
_LEAST_CELLS = 12
_MOST_CELLS = 160
_FINER = 1.5  # from one trial to the next
_ENOUGH_MM = 1e-8  # rms at the points left out
_BETTER = 0.9  # of the error: a finer spline must be worth its cells
_SMALLEST_GAP = 4.0  # largest hole, in typical distances between neighbours
# Weight of the third differences of the control values against that of a point, times the points in a cell: the
# points decide wherever there are any. Of 1e-6 to 1e-10 the error of a sphere through 10,000 points is the same.
_STIFFNESS = 1e-8
_CHECKED = 2000
_SEED = 0


def face_of_points(path: Path, coordinates: Coordinates, shift_mm: tuple[float, float, float]) -> GivenFace:
    """The face through the points of a text file, moved by ``shift_mm``.

    Cartesian: x, y, z in mm; polar: angle from the axis and azimuth in degrees, and the distance from the origin in mm.
    Raises :class:`InputError`, with the place, if points leave a part of the hemisphere uncovered.
    """
    rows = read_cloud(path, "give the file of the points on the face", coordinates)
    points = (rows if coordinates == "cartesian" else _from_polar(rows, path)) + np.asarray(shift_mm)
    radius = np.linalg.norm(points, axis=1)
    if not (radius > 0.0).all():
        raise InputError(f"{path}: a point lies at the origin, where the source is; remove it, or check shift_mm")
    directions = points / radius[:, None]
    _require_covered(directions, path)
    surface, form_nm, normal_urad = _fitted(directions, radius)
    return GivenFace(surface, f"{len(points)} points of {path.name}", form_nm, normal_urad)


def _from_polar(rows: Float[np.ndarray, "n 3"], path: Path) -> Float[np.ndarray, "n 3"]:
    polar = np.deg2rad(rows[:, 0])
    azimuth = np.deg2rad(rows[:, 1])
    radius = rows[:, 2]
    if polar.min() < 0.0 or polar.max() > np.pi or np.abs(azimuth).max() > 2.0 * np.pi:
        raise InputError(
            f"{path}: angles from the axis of {np.rad2deg(polar.min()):.4g} to {np.rad2deg(polar.max()):.4g} degrees, "
            "must be 0 to 180, azimuths -360 to 360; in each line: angle from the axis, azimuth, distance in mm"
        )
    unit = [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    return radius[:, None] * np.stack(unit, axis=1)


def _require_covered(directions: Float[np.ndarray, "n 3"], path: Path) -> None:
    """Raise :class:`InputError` if a direction of the hemisphere is far from all points."""
    from scipy.spatial import KDTree

    tree = KDTree(directions)
    typical = float(np.median(tree.query(directions, 2)[0][:, 1]))
    typical = max(typical, float(np.sqrt(2.0 * np.pi / len(directions))))  # points that are twice there count once
    wanted = fibonacci_hemisphere(_CHECKED)  # the lowest lie on the rim to a thirtieth of a degree
    gap = tree.query(wanted)[0]
    worst = int(gap.argmax())
    if gap[worst] > _SMALLEST_GAP * typical:
        raise InputError(
            f"{path}: no point within {np.rad2deg(gap[worst]):.3g} degrees of the direction {place_of(wanted[worst])}; "
            f"neighbours are {np.rad2deg(typical):.2g} degrees apart; add points there, down to z = 0"
        )


def _fitted(directions: Float[np.ndarray, "n 3"], radius: Float[np.ndarray, " n"]) -> tuple[ChartSpline, float, float]:
    """Spline through all points, and its largest errors (nm, urad), cross-validated on a tenth of the points.

    The grid is refined until the points left out are met no better.
    """
    order = np.random.default_rng(_SEED).permutation(len(radius))
    order = order[directions[order, 2] >= 0.0]  # below z = 0 no surface counts
    out = order[::_LEFT_OUT]
    fitted = np.setdiff1d(np.arange(len(radius)), out)
    most = min(_MOST_CELLS, int(2.0 * HALF_WIDTH * np.sqrt(len(radius) / np.pi)))
    cells = _LEAST_CELLS
    best = None
    while True:
        trial = _spline(directions[fitted], radius[fitted], cells)
        miss = float(np.sqrt(np.mean((trial.radius(directions[out]) - radius[out]) ** 2)))
        if best is None or miss < _BETTER * best[0]:
            best = (miss, cells, trial)
        elif cells > 2 * best[1]:
            break
        if cells >= most or miss < _ENOUGH_MM:
            break
        cells = min(most, int(np.ceil(_FINER * cells)))
    surface = _spline(directions, radius, best[1])
    form_nm = np.abs(best[2].radius(directions[out]) - radius[out]).max() * 1e6
    turned = np.linalg.norm(np.cross(surface.normal(directions[out]), best[2].normal(directions[out])), axis=1)
    return surface, float(form_nm), float(turned.max() * 1e6)


def _spline(directions: Float[np.ndarray, "n 3"], radius: Float[np.ndarray, " n"], cells: int) -> ChartSpline:
    """Least squares over a grid of ``cells`` x ``cells``, even in angle."""
    from scipy.interpolate import NdBSpline
    from scipy.sparse.linalg import splu

    half = np.arctan(HALF_WIDTH)
    breaks = np.tan(np.linspace(-half, half, cells + 1))
    knots = np.concatenate([np.full(DEGREE, breaks[0]), breaks, np.full(DEGREE, breaks[-1])])
    chart = to_chart(directions)
    inside = np.abs(chart).max(axis=1) <= HALF_WIDTH
    design = NdBSpline.design_matrix(chart[inside], (knots, knots), DEGREE)
    design.resize((inside.sum(), (cells + DEGREE) ** 2))  # scipy leaves out columns after the last one that is used
    mean = float(radius.mean())
    stiff = _STIFFNESS * inside.sum() / cells**2 * _differences(cells + DEGREE)
    control = splu((design.T @ design + stiff).tocsc()).solve(design.T @ (radius[inside] - mean)) + mean
    table = control.reshape(cells + DEGREE, cells + DEGREE)
    return ChartSpline(knots, table, detail_of(knots, table))


def _differences(side: int) -> Any:
    """Sum of the squared third differences of a square table along both axes, as a sparse matrix."""
    from scipy.sparse import diags_array, eye_array, kron

    steps = ((0, -1.0), (1, 3.0), (2, -3.0), (3, 1.0))
    third = sum(
        value * diags_array(np.ones(side - 3), offsets=offset, shape=(side - 3, side)) for offset, value in steps
    )
    squared = third.T @ third
    whole = eye_array(side)
    return kron(squared, whole) + kron(whole, squared)
