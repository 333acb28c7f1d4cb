"""Form and normal error of a CAD face against the exact surface, never measured at the nodes of its spline.

"Valid and watertight" says nothing about form: a face that is 12 um off passes every topological test.
"""

from collections.abc import Callable, Mapping
from dataclasses import astuple, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.cad.boundary import WHOLE, Domain, Pair, lens_boundaries, of_shapes
from lensforge.cad.face_tolerance import FINEST, MAX_NODES, FaceTolerance, face_tolerance
from lensforge.cad.outline import FULL_TURN
from lensforge.cad.patch import FIRST_PER_SIGMA, LEAST_NODES, Patch, default_nodes, fewest_nodes, fit_patch
from lensforge.cad.plan import rim_directions
from lensforge.errors import InputError
from lensforge.kernels.parallel import in_parallel_map
from lensforge.results.refined_maximum import refined_maximum
from lensforge.scene.lens import Lens
from lensforge.seeds import sobol
from lensforge.spec.accuracy import preset_of
from lensforge.surfaces.mirror_group import first_images
from lensforge.surfaces.surface import Surface, to_chart

SAMPLES = 4096
_RIM_SHARE = 4  # for every four samples a further one lies exactly on the rim, where splines are worst
_SAME_CHART = 1e-3
# Between the nodes of a spline its error rises and falls, with 240 nodes every 0.005 of the chart; samples
# are 0.03 apart. Against 400,000 points the largest of the samples is 1 to 22 % too low, that of the search up to 3 %.
_REACH = 0.01
_STARTS = 24
_ROUNDS = 4
# A fit aims a little below the largest errors that are accepted. While nodes are few, errors fall with such a power of
# them; later with the eighth and the seventh, of normals.
_AIM = 0.95
_OF_ROUNDING = 0.02
_ORDER = 12


@dataclass(frozen=True)
class FormError:
    """Largest and rms distance along the normal (nm) and angle between normals (mrad)."""

    form_max_nm: float
    form_rms_nm: float
    normal_max_mrad: float
    normal_rms_mrad: float


def worst(errors: list[FormError]) -> FormError:
    """The largest of each error."""
    return FormError(*(max(values) for values in zip(*map(astuple, errors), strict=True)))


def chart_samples(count: int = SAMPLES, seed: int = 0, domain: Domain = WHOLE) -> Float[np.ndarray, "n 2"]:
    """Chart points of ``count`` directions, uniform over ``domain`` at each azimuth, and a quarter more on its edge."""
    rim = count // _RIM_SHARE
    inside = sobol(count, 2, np.random.default_rng(seed))
    share = inside[:, 0]
    azimuth = FULL_TURN * inside[:, 1]
    top, bottom = ((1.0 - radius**2) / (1.0 + radius**2) for radius in domain.radii(azimuth))
    height = bottom + (top - bottom) * share
    radius = np.sqrt((1.0 - height) / (1.0 + height))  # tan(theta/2) of cos(theta) = height
    within = radius[:, None] * rim_directions(azimuth)[:, :2]
    turn = FULL_TURN * (np.arange(rim) + np.random.default_rng(seed).random()) / rim
    return np.concatenate([within, domain.radii(turn)[1][:, None] * rim_directions(turn)[:, :2]])


def fit_lens(lens: Lens, *nodes: int, tolerance: FaceTolerance | None = None) -> Pair[Patch]:
    """The boundaries of ``lens`` by its exported faces; equal node counts give the same bits.

    ``nodes``: of each face, in the order of the lens; by default as many as ``tolerance`` needs, which is by default
    that of the lens.
    """
    known = _fits(lens)
    wanted = tolerance or face_tolerance(lens)
    if (nodes, wanted) not in known:
        given = dict(zip(lens.surfaces, nodes, strict=True)) if nodes else {}
        pair = fit_boundaries(lens_boundaries(lens), given, preset_of(lens.accuracy).part.spline_nodes, wanted)
        counts = {face.name: face.shape.nodes for boundary in pair for face in boundary.faces}
        known[nodes, wanted] = known[tuple(counts[name] for name in lens.surfaces), wanted] = pair
    return known[nodes, wanted]


def remember_fit(lens: Lens, nodes: Mapping[str, int]) -> None:
    """Store the fit of ``lens`` by ``nodes``, by name, as an export found them: to search them again takes a second.

    Those of a lens that is drawn along y are nodes of its section, by which nothing is fitted.
    """
    if lens.spec.lens.drawn_mm is None and nodes.keys() == lens.surfaces.keys():
        _fits(lens)[(), face_tolerance(lens)] = fit_lens(lens, *(nodes[name] for name in lens.surfaces))


@lru_cache(maxsize=4)  # of one lens in several stages: a second each
def _fits(_: Lens) -> dict[tuple[tuple[int, ...], FaceTolerance], Pair[Patch]]:
    """Known fits of a lens, by requested and by actual nodes."""
    return {}


def fit_boundaries(
    pair: Pair[Surface],
    nodes: Mapping[str, int],
    least: int = LEAST_NODES,
    tolerance: FaceTolerance = FINEST,
    between: bool = True,
) -> Pair[Patch]:
    """The boundaries of cavity and body by fitted faces.

    ``nodes``: by name; by default as many as ``tolerance`` needs, at least ``least``; ``between``: also tested between
    samples.
    """
    faces = [face for boundary in pair for face in boundary.of_material]
    fitted = in_parallel_map(
        lambda face: fit_to_form(
            face.shape,
            nodes.get(face.name),
            face.domain,
            least,
            FINEST if face.is_flange or face.is_ring else tolerance,
            between,
        ),
        faces,
    )
    patches = dict(zip((face.name for face in faces), fitted, strict=True))
    return of_shapes(pair, patches)


def fit_to_form(
    surface: Surface,
    nodes: int | None = None,
    domain: Domain = WHOLE,
    least: int = LEAST_NODES,
    tolerance: FaceTolerance = FINEST,
    between: bool = True,
) -> Patch:
    """The patch of ``surface`` with ``nodes``; by default ``least``, or as many as its ``tolerance`` needs.

    The tolerance is tested at samples, one of each set of mirror images, and by default ``between`` them, too, as it is
    judged. Control points are rounded to decimals that cost at most a fiftieth of it.
    """
    if nodes is not None:
        return rounded_to(fit_patch(surface, nodes, domain.extent), tolerance)
    chart = chart_samples(domain=domain)
    least = max(least, fewest_nodes(domain.extent))
    count = default_nodes(surface.detail_rad, least, FIRST_PER_SIGMA)
    # creases may have other images than the face
    first = chart if domain.edges else chart[first_images(chart, surface.symmetry)]
    while True:
        patch = rounded_to(fit_patch(surface, count, domain.extent), tolerance)
        excess = _excess(form_error(surface, patch.points(first), patch.normals(first)), tolerance)
        if excess <= 1.0 and between:
            excess = _excess(largest_errors(surface, patch.points_and_normals, chart, domain), tolerance)
        if excess <= 1.0 or count == MAX_NODES:
            return patch
        count = min(MAX_NODES, max(count + 1, int(np.ceil(count * excess ** (1.0 / _ORDER)))))


def _excess(error: FormError, tolerance: FaceTolerance) -> float:
    """The larger ratio of an error to a fit's aim."""
    return max(error.form_max_nm / tolerance.form_nm, error.normal_max_mrad / tolerance.normal_mrad) / _AIM


def rounded_to(patch: Patch, tolerance: FaceTolerance) -> Patch:
    """The patch with no more decimals than its ``tolerance`` needs."""
    middle = len(patch.control) // 2
    apart_mm = float(np.linalg.norm(np.diff(patch.control[middle - 1 : middle + 1, middle], axis=0)))
    by_normal_mm = 1e-3 * tolerance.normal_mrad * apart_mm
    return patch.rounded(_OF_ROUNDING * min(1e-6 * tolerance.form_nm, by_normal_mm))


def face_points(
    face: Any, chart: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Points (mm) and unit normals of a face (TopoDS_Face) at its parameters ``chart``, by the CAD kernel itself."""
    from OCP.BRep import BRep_Tool
    from OCP.gp import gp_Pnt, gp_Vec

    surface = BRep_Tool.Surface_s(face)
    point = gp_Pnt()
    along_x = gp_Vec()
    along_y = gp_Vec()
    points = np.empty((len(chart), 3))
    normals = np.empty((len(chart), 3))
    for k, (x, y) in enumerate(chart.tolist()):
        surface.D1(x, y, point, along_x, along_y)
        normal = along_x.Crossed(along_y)
        points[k] = point.X(), point.Y(), point.Z()
        normals[k] = normal.X(), normal.Y(), normal.Z()
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def form_error(surface: Surface, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> FormError:
    """Compare points and normals with ``surface``; the distance is the radial one times the cosine, to first order."""
    distance, angle = _errors(surface, points, normals)
    return FormError(float(distance.max()), _rms(distance), float(angle.max()), _rms(angle))


def _errors(
    surface: Surface, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Distance (nm) and angle between normals (mrad) from ``surface`` at each point, both at least 0."""
    radius = np.linalg.norm(points, axis=1)
    directions = points / radius[:, None]
    rho, gradient = surface.radius_and_gradient(directions)
    exact = directions - gradient / rho[:, None]
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    distance = np.abs(radius - rho) * np.sum(exact * directions, axis=1) * 1e6
    sine = np.linalg.norm(np.cross(normals, exact), axis=1)
    cosine = np.abs(np.sum(normals * exact, axis=1))
    return distance, np.arctan2(sine, cosine) * 1e3


Evaluate = Callable[[Float[np.ndarray, "n 2"]], tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]]


def largest_errors(
    surface: Surface, evaluate: Evaluate, chart: Float[np.ndarray, "n 2"], domain: Domain = WHOLE
) -> FormError:
    """Form error at ``chart`` points, its largest values refined between them, within ``domain``.

    ``evaluate``: points (mm) and unit normals of the face at chart points.
    """
    distance, angle = _errors(surface, *evaluate(chart))

    def largest(kind: int, values: Float[np.ndarray, " n"]) -> float:
        def error(points: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, " m"]:
            return _errors(surface, *evaluate(points))[kind]

        return refined_maximum(error, chart, values, _REACH, starts=_STARTS, rounds=_ROUNDS, within=domain.within)[1]

    return FormError(largest(0, distance), _rms(distance), largest(1, angle), _rms(angle))


def face_error(surface: Surface, face: Any, count: int = SAMPLES, domain: Domain = WHOLE) -> FormError:
    """Form error of a face over its domain. Raises :class:`InputError` if its parameters are not the chart's."""

    def evaluate(chart: Float[np.ndarray, "n 2"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        points, normals = face_points(face, chart)
        if not np.allclose(to_chart(points), chart, atol=_SAME_CHART):
            raise InputError("the optical face is not over the lens's chart; run `lensforge export` again")
        return points, normals

    return largest_errors(surface, evaluate, chart_samples(count, domain=domain), domain)


def _rms(values: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(values**2)))
