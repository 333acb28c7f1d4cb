"""Form and normal error of a CAD face against the exact surface, never measured at the nodes of its spline.

"Valid and watertight" says nothing about form: a face that is 12 um off passes every topological test.

Largest values are searched for between the samples of the chart's unit disc. A largest sample is below the largest
value by the square of the samples' spacing. Grids that shrink about the best few samples close that gap: each round
halves the window, so after ``rounds`` the place is known to ``reach / 2^rounds``.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.cad.outline import FULL_TURN
from lensforge.cad.part_limits import FORM_LIMIT_NM, NORMAL_LIMIT_MRAD
from lensforge.cad.patch import MAX_NODES, Patch, default_nodes, fit_patch
from lensforge.cad.plan import rim_directions
from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.surfaces.surface import Surface, to_chart

_WINDOW_SIDE = 5  # nodes across the grid about each start
STARTS = 8  # the best sample alone may lie beside a lower peak


def refined_maximum(
    figure: Callable[[Float[np.ndarray, "m 2"]], Float[np.ndarray, " m"]],
    chart: Float[np.ndarray, "k 2"],
    values: Float[np.ndarray, " k"],
    reach: float,
    *,
    starts: int = STARTS,
    rounds: int = 8,
) -> tuple[Float[np.ndarray, "2"], float]:
    """Chart point and value of the largest ``figure`` of the disc, searched within ``reach`` of the best samples.

    ``values``: the figure at the samples ``chart``, NaN where it has none; never less than their largest is returned.
    ``reach``: chart units, about the spacing of the samples or, if that is less, the width of the figure's peaks.
    """
    known = np.where(np.isnan(values), -np.inf, values)
    best = np.argsort(-known, kind="stable")[:starts]
    places, highest = chart[best], known[best]
    axis = np.linspace(-1.0, 1.0, _WINDOW_SIDE)
    around = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    for _ in range(rounds):
        window = (places[:, None] + reach * around).reshape(-1, 2)
        window /= np.maximum(1.0, np.linalg.norm(window, axis=1, keepdims=True))
        found = figure(window).reshape(len(places), -1)
        found = np.where(np.isnan(found), -np.inf, found)
        top = np.argmax(found, axis=1)
        higher = np.take_along_axis(found, top[:, None], axis=1)[:, 0]
        there = window.reshape(len(places), -1, 2)[np.arange(len(places)), top]
        places = np.where((higher > highest)[:, None], there, places)
        highest = np.maximum(highest, higher)
        reach /= 2.0
    first = int(np.argmax(highest))
    return places[first], float(highest[first])


SAMPLES = 4096
_RIM_SHARE = 4  # for every four samples a further one lies exactly on the rim, where splines are worst
_SAME_CHART = 1e-3
# Between the nodes of a spline its error rises and falls, on the finest (240 nodes) every 0.005 of the chart; samples
# are 0.03 apart. Against 400,000 points the largest of the samples is 1 to 22 % too low, that of the search up to 3 %.
_REACH, _STARTS, _ROUNDS = 0.01, 24, 4
# A fit aims at half of the largest errors that are accepted; errors fall with these powers of the node count.
_FORM_AIM_NM, _NORMAL_AIM_MRAD = 0.5 * FORM_LIMIT_NM, 0.5 * NORMAL_LIMIT_MRAD
_FORM_ORDER, _NORMAL_ORDER = 6, 5

Place = tuple[float, float, float]


@dataclass(frozen=True)
class FormError:
    """Largest and rms distance along the normal (nm) and angle between normals (mrad); points of the largest (mm)."""

    form_max_nm: float
    form_rms_nm: float
    normal_max_mrad: float
    normal_rms_mrad: float
    form_at_mm: Place
    normal_at_mm: Place


def worst(errors: list[FormError]) -> FormError:
    """The largest of each error, with its point."""
    form = max(errors, key=lambda error: error.form_max_nm)
    normal = max(errors, key=lambda error: error.normal_max_mrad)
    return FormError(
        form.form_max_nm,
        max(error.form_rms_nm for error in errors),
        normal.normal_max_mrad,
        max(error.normal_rms_mrad for error in errors),
        form.form_at_mm,
        normal.normal_at_mm,
    )


def chart_samples(count: int = SAMPLES, seed: int = 0) -> Float[np.ndarray, "n 2"]:
    """Chart points of ``count`` Sobol directions, uniform over the hemisphere, and of a quarter more on the rim."""
    from scipy.stats import qmc  # a quarter of a second

    rim = count // _RIM_SHARE
    inside = qmc.Sobol(2, seed=seed).random(count)
    height, azimuth = inside[:, 0], FULL_TURN * inside[:, 1]
    radius = np.sqrt((1.0 - height) / (1.0 + height))  # tan(theta/2) of cos(theta) = height
    inner = radius[:, None] * rim_directions(azimuth)[:, :2]
    turn = np.random.default_rng(seed).random()
    return np.concatenate([inner, rim_directions(FULL_TURN * (np.arange(rim) + turn) / rim)[:, :2]])


@lru_cache(maxsize=4)  # of one lens in several stages: a second each
def fit_faces(lens: Lens, inner_nodes: int | None = None, outer_nodes: int | None = None) -> tuple[Patch, Patch]:
    """The inner and the outer face of ``lens`` as they are exported; the same node counts give the same bits."""
    with ThreadPoolExecutor() as pool:
        inner, outer = pool.map(fit_to_form, (lens.inner, lens.outer), (inner_nodes, outer_nodes))
    return inner, outer


def fit_to_form(surface: Surface, nodes: int | None = None) -> Patch:
    """The patch of ``surface`` with ``nodes``; by default as many as its measured form and normal errors need."""
    if nodes is not None:
        return fit_patch(surface, nodes)
    chart, count = chart_samples(), default_nodes(surface.detail_rad)
    while True:
        patch = fit_patch(surface, count)
        error = form_error(surface, patch.points(chart), patch.normals(chart))
        by_form = (error.form_max_nm / _FORM_AIM_NM) ** (1.0 / _FORM_ORDER)
        by_normal = (error.normal_max_mrad / _NORMAL_AIM_MRAD) ** (1.0 / _NORMAL_ORDER)
        if max(by_form, by_normal) <= 1.0 or count == MAX_NODES:
            return patch
        count = min(MAX_NODES, max(count + 1, int(np.ceil(count * max(by_form, by_normal)))))


def face_points(
    face: Any, chart: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Points (mm) and unit normals of a ``cadquery.Face`` at its parameters ``chart``, by the CAD kernel itself."""
    from OCP.BRep import BRep_Tool
    from OCP.gp import gp_Pnt, gp_Vec

    surface = BRep_Tool.Surface_s(face.wrapped)
    point, along_x, along_y = gp_Pnt(), gp_Vec(), gp_Vec()
    points, normals = np.empty((len(chart), 3)), np.empty((len(chart), 3))
    for k, (x, y) in enumerate(chart.tolist()):
        surface.D1(x, y, point, along_x, along_y)
        normal = along_x.Crossed(along_y)
        points[k] = point.X(), point.Y(), point.Z()
        normals[k] = normal.X(), normal.Y(), normal.Z()
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def form_error(surface: Surface, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> FormError:
    """Compare points and normals with ``surface``; the distance is the radial one times the cosine, to first order."""
    distance, angle = _errors(surface, points, normals)
    farthest, steepest = int(np.argmax(distance)), int(np.argmax(angle))
    return FormError(
        float(distance[farthest]),
        _rms(distance),
        float(angle[steepest]),
        _rms(angle),
        _place(points[farthest]),
        _place(points[steepest]),
    )


def _errors(
    surface: Surface, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Distance (nm) and angle between normals (mrad) from ``surface`` at each point, both at least 0."""
    radius = np.linalg.norm(points, axis=1)
    directions = points / radius[:, None]
    rho = surface.radius(directions)
    exact = directions - surface.gradient(directions) / rho[:, None]
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    distance = np.abs(radius - rho) * np.sum(exact * directions, axis=1) * 1e6
    sine = np.linalg.norm(np.cross(normals, exact), axis=1)
    cosine = np.abs(np.sum(normals * exact, axis=1))
    return distance, np.arctan2(sine, cosine) * 1e3


Evaluate = Callable[[Float[np.ndarray, "n 2"]], tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]]


def largest_errors(surface: Surface, evaluate: Evaluate, chart: Float[np.ndarray, "n 2"]) -> FormError:
    """Form error at ``chart`` points, its largest values searched for between them too.

    ``evaluate``: points (mm) and unit normals of the face at chart points.
    """
    sampled = evaluate(chart)
    found = form_error(surface, *sampled)
    for kind, values in enumerate(_errors(surface, *sampled)):

        def error(points: Float[np.ndarray, "m 2"], kind: int = kind) -> Float[np.ndarray, " m"]:
            return _errors(surface, *evaluate(points))[kind]

        place, largest = refined_maximum(error, chart, values, _REACH, starts=_STARTS, rounds=_ROUNDS)
        at = _place(evaluate(place[None])[0][0])
        if kind == 0:
            found = replace(found, form_max_nm=largest, form_at_mm=at)
        else:
            found = replace(found, normal_max_mrad=largest, normal_at_mm=at)
    return found


def face_error(surface: Surface, face: Any, count: int = SAMPLES) -> FormError:
    """Form error of a face over the hemisphere. Raises :class:`InputError` if its parameters are not the chart's."""
    chart = chart_samples(count)
    if not np.allclose(to_chart(face_points(face, chart)[0]), chart, atol=_SAME_CHART):
        raise InputError("the optical face is not over the lens's chart; run `lensforge export` again")
    return largest_errors(surface, lambda points: face_points(face, points), chart)


def _rms(values: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _place(point: Float[np.ndarray, "3"]) -> Place:
    x, y, z = point.tolist()
    return x, y, z
