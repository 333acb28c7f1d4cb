"""Parts as they are traced, from their deviations: tables and places of the faces, index, size of the source.

Form errors of a face are tables, prepared once, and added to the table of the face with the numbers of each part. A
field is a sum of tables with independent Gaussian numbers, whose mean square over the hemisphere and over the parts is
1 mm^2 along the normal. Radii add linearly: an error e along the normal is taken as one along the radius of e over the
cosine between the two, which neglects terms of e times its own slope (1e-6 of it at a micrometre).

Where a ray may meet any of several faces, a face out of place is such an error, too: along the normal, that of its
displacement. This leaves out the displacement's square over twice the face's radius of curvature, 0.1 um of 25 um.

Waviness has the spectral density k^-2 between two wavelengths: a mixture of Gaussian low-pass
fields whose widths s (correlation exp(-r^2 / 2 s^2) over the chord r) are evenly spread over their logarithm, all of
the same variance. A sum of waves in space with normally distributed wave vectors, read on the face, is such a field
(Rahimi and Recht, Random features, 2007). What is too narrow for the tables counts as roughness, by the rms slope it
has, the same along every line.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from lensforge.optics.arrays import Array, like, module_of
from lensforge.optics.face_roles import DOUBLE, FaceRole
from lensforge.optics.media import Media
from lensforge.optics.pose import IN_PLACE, ORIGIN, FacePoses, Pose, Vector
from lensforge.scene.body import Chain
from lensforge.scene.perturbations import Deviations
from lensforge.spec import Spec
from lensforge.spec.tolerances_section import FORM_NUMBERS, PLACEMENT, WAVINESS_NUMBERS, Factor, factor_name
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.srbf import SrbfBasis, fibonacci_hemisphere
from lensforge.surfaces.surface import Surface

_NOISE_SEED = 20_29  # of the roughness: any number; the same in every trace, so that parts compare ray by ray


@dataclass(frozen=True)
class AsMade:
    """Deviations of one made lens from its design, the same for all rays.

    ``names``: of the faces, from the source on. ``source``: displacement of the source about its own place,
    ``source_centre_mm``, about which it is ``source_size`` times as large; ``lens``: of the whole lens, which is
    ``scale`` times as large about its seat, ``seat_mm`` below its origin; ``faces``: of a face against the body, whose
    place is that of the first face. ``slopes``: roughness of a face, rms of the slope along any line on it. Faces left
    out are as designed.
    """

    names: tuple[str, ...] = DOUBLE
    source: Pose = IN_PLACE
    source_centre_mm: Vector = ORIGIN
    lens: Pose = IN_PLACE
    faces: Mapping[str, Pose] = field(default_factory=dict)
    source_size: float = 1.0
    scale: float = 1.0
    seat_mm: float = 0.0
    slopes: Mapping[str, float] = field(default_factory=dict)

    @property
    def placed(self) -> FacePoses:
        """Places of the faces.

        Frames go from the source to the first face, from face to face, and from the last one to the world. The seat
        stays: an origin ``seat_mm`` above it comes to lie ``seat_mm (scale - 1)`` higher.
        """
        # source: o' = c + R k (o - c) + shift; lens: p' = R (s p + up) + shift
        centre = np.array(self.source_centre_mm)
        up = np.array([0.0, 0.0, self.seat_mm * (self.scale - 1.0)])
        emitted = centre - self.source_size * self.source.directions(centre) + np.array(self.source.origin_mm)
        source = self.source.seen_from(self.lens).at((self.lens.to_local_points(emitted) - up) / self.scale)
        faces = [self.faces.get(name, IN_PLACE) for name in self.names]
        last = faces[-1].at(self.scale * np.array(faces[-1].origin_mm) + up)
        between = tuple(face.seen_from(next_face) for face, next_face in pairwise(faces))
        into = source.seen_from(faces[0])
        back = self.lens.after(last)
        return FacePoses(into, between, back, self.source_size / self.scale, self.scale)

    @property
    def slopes_of_faces(self) -> Float[np.ndarray, " f"]:
        """Roughness of each face."""
        return np.array([self.slopes.get(name, 0.0) for name in self.names])

    def rough(self, rays: int) -> Float[np.ndarray, "n m"] | None:
        """Slopes of the facets of so many rays along two lines on each face, over its own; None of polished faces."""
        return _noise(rays, len(self.names)) if self.slopes_of_faces.any() else None


def at_work(spec: Spec, names: tuple[str, ...]) -> AsMade | None:
    """The lens of ``spec`` at its temperature, as it grows about its seat; None at that of reference.

    ``names``: of its faces, from the source on.
    """
    scale = spec.lens.scale
    return None if scale == 1.0 else AsMade(names, scale=scale, seat_mm=spec.base.seat_mm)


@lru_cache(maxsize=2)
def _noise(rays: int, faces: int) -> Float[np.ndarray, "n m"]:
    """Two standard normal numbers of each ray at every face.

    Not made read-only: for such an array the kernels would be compiled once more.
    """
    return np.random.default_rng(_NOISE_SEED).standard_normal((rays, 2 * faces))


# Width of a low-pass field over the wavelength where its density has fallen to 1/e: exp(-k^2 s^2 / 2), k = 2 pi / l.
_WIDTH = float(np.sqrt(2.0) / (2.0 * np.pi))
_SIGMA_C = 1.75  # of the broad functions: neighbours overlap
_NODES_PER_WIDTH = 2.0  # of a table: its spline is then within 1 % of the field (tests/scene/test_form_errors.py)
_NODES_PER_PERIOD = 8.0  # of rings, whose spline is then within 1 %, too
_WAVES = 384  # of a field: its values are then normal within 1 %, and its spectrum smooth
_SAMPLES = 4000


@dataclass(frozen=True, eq=False)
class ErrorField:
    """One field: ``tables`` (k, side, side) in mm per unit number, and the ``slope`` (per mm of its rms, along any
    line) of what is too fine for them.
    """

    tables: Float[np.ndarray, "k side side"]
    slope: float = 0.0


@dataclass(frozen=True, eq=False)
class FaceNodes:
    """A face at the nodes of a grid: points (mm), and cosines between normal and radius, to 1e-3 by differences."""

    grid: TableGrid
    directions: Float[np.ndarray, "k 3"]
    points: Float[np.ndarray, "k 3"]
    cosines: Float[np.ndarray, " k"]

    @staticmethod
    def of(grid: TableGrid, surface: Surface) -> "FaceNodes":
        """Sample ``surface``."""
        u = grid.sample_directions()
        count = round(np.sqrt(len(u)))
        radius = surface.radius_on_grid(u.reshape(count, count, 3))
        # on the sphere the chart is smaller by its conformal factor, 2 / (1 + R^2) = 1 + z
        slope = np.hypot(*np.gradient(radius, grid.step)) / (1.0 + u[:, 2].reshape(count, count))
        cosines = 1.0 / np.sqrt(1.0 + (slope / radius) ** 2)
        return FaceNodes(grid, u, radius.reshape(-1, 1) * u, cosines.reshape(-1))

    @property
    def most_mm(self) -> float:
        """Largest radius."""
        return float(np.linalg.norm(self.points, axis=1).max())

    def table(self, fields: Float[np.ndarray, "k c"], slope: float = 0.0) -> ErrorField:
        """The form error with these fields (mm) along the normal."""
        grid = self.grid
        coefficients = grid.coefficients(fields / self.cosines[:, None])
        return ErrorField(np.ascontiguousarray(coefficients.T).reshape(-1, grid.side, grid.side), slope)

    def none(self, slope: float) -> ErrorField:
        """The form error of which the tables hold nothing."""
        return ErrorField(np.zeros((0, self.grid.side, self.grid.side)), slope)


def low_order(face: FaceNodes) -> ErrorField:
    """Broad errors of a face: ``FORM_NUMBERS`` basis functions over the hemisphere."""
    basis = SrbfBasis((FORM_NUMBERS,), _SIGMA_C)
    square = np.sum(basis.evaluate(fibonacci_hemisphere(_SAMPLES)) ** 2, axis=1).mean()
    return face.table(basis.evaluate(face.directions) / np.sqrt(square))


def waviness(face: FaceNodes, shortest_mm: float, longest_mm: float, seed: int) -> ErrorField:
    """Errors of a face with wavelengths between two: ``WAVINESS_NUMBERS`` random fields of the spectrum."""
    places = (np.arange(_WAVES) + 0.5) / _WAVES
    widths_mm = _WIDTH * longest_mm * (shortest_mm / longest_mm) ** places
    fits = widths_mm >= _NODES_PER_WIDTH * 2.0 * face.grid.step * face.most_mm  # a step is 2 rad wide at the apex
    slope = float(np.sqrt(np.sum(1.0 / _WAVES / widths_mm[~fits] ** 2)))
    rng = np.random.default_rng(seed)
    vectors = rng.standard_normal((_WAVES, 3)) / widths_mm[:, None]
    numbers = rng.standard_normal((2, _WAVES, WAVINESS_NUMBERS)) * np.sqrt(1.0 / _WAVES / WAVINESS_NUMBERS)
    if not fits.any():
        return face.none(slope)
    phases = face.points @ vectors[fits].T
    return face.table(np.cos(phases) @ numbers[0, fits] + np.sin(phases) @ numbers[1, fits], slope)


def ripple(face: FaceNodes, period_mm: float) -> ErrorField:
    """Rings about the axis, peak to valley 1 mm: one table, or their slope where they are too fine for one.

    A ring's slope lies across it alone; as roughness it counts half along every line.
    """
    if period_mm < _NODES_PER_PERIOD * 2.0 * face.grid.step * face.most_mm:
        return face.none(0.5 * np.pi / period_mm)
    phase = 2.0 * np.pi / period_mm * np.hypot(face.points[:, 0], face.points[:, 1])
    return face.table(0.5 * np.cos(phase)[:, None])


def displaced(face: FaceNodes, surface: Surface) -> dict[str, ErrorField]:
    """Displacements of a face by the fields of its table: a shift along x and y (mm), along z, a tilt about x and y."""
    normals = surface.normal(face.directions)
    turned = np.cross(face.points, normals)  # (w x p) . n = w . (p x n)
    fields = {"shift_mm": normals[:, :2], "gap_mm": normals[:, 2:], "tilt_deg": turned[:, :2]}
    return {name: face.table(field) for name, field in fields.items()}


_SEED = 5  # of the shapes of waviness: any number; those of two faces differ
_NONE = np.zeros(2)
_FIELDS = ("form_um", "waviness_um", "ripple_um")  # errors of a face that have tables
_IN_CHAINS = (*_FIELDS, *PLACEMENT)  # of a face that is one of several between the same media


@dataclass(frozen=True, eq=False)
class MadePart:
    """One part: errors of its faces' tables (mm) by name, none where left out, its deviations, of index and flux too.

    ``made``: also names the faces, in the order of all tables; of a LED at the origin, at the temperature of reference.
    """

    errors: Mapping[str, Float[np.ndarray, "side side"]]
    made: AsMade
    index: float
    flux: float

    def in_state(self, spec: Spec) -> "MadePart":
        """The same part with its LED and its temperature of ``spec``, of one state: the LED is off by as much there."""
        scale = spec.lens.scale * self.made.scale
        return replace(self, made=replace(self.made, source_centre_mm=spec.source.position_mm, scale=scale))

    def media(self, media: Media) -> Media:
        """``media`` with the index of the batch."""
        return media if self.index == 0.0 else replace(media, body=replace(media.body, index_error=self.index))

    def tables(self, designed: Float[Array, "f side side"]) -> Float[Array, "f side side"]:
        """The faces' tables with their errors, in the order of ``made.names``; differentiable in those as designed."""
        errors = [self.errors.get(name) for name in self.made.names]
        if all(error is None for error in errors):
            return designed
        faces = zip(designed, errors, strict=True)
        made = [table if error is None else table + like(table, error) for table, error in faces]
        return module_of(designed).stack(made)


@dataclass(frozen=True, eq=False)
class PartMaker:
    """All that is prepared once for the faces of a lens: the tables of their form errors, by the name of the factor.

    ``names``: of the faces, in the order of all tables; ``roles``: of the faces that the spec has. ``warmed_by``: what
    so many kelvin change, the index by a difference and all lengths by a factor.
    """

    names: tuple[str, ...]
    roles: tuple[FaceRole, ...]
    errors: dict[str, ErrorField]
    seat_mm: float
    warmed_by: Callable[[float], tuple[float, float]]

    @staticmethod
    def of(spec: Spec, surfaces: Mapping[str, Surface], grid: TableGrid, factors: tuple[Factor, ...]) -> "PartMaker":
        """Prepare the form errors of ``surfaces``, by name from the source on, on tables of ``grid``."""
        roles = spec.lens.roles
        section = spec.tolerances
        wanted = {factor.name for factor in factors}
        in_chain = Chain.of_lens(spec.lens) is not None
        band = section.waviness_shortest_mm, section.waviness_longest_mm
        errors: dict[str, ErrorField] = {}
        for number, (face, surface) in enumerate(surfaces.items()):
            form, waves, rings = names = [factor_name(roles, face, kind) for kind in _FIELDS]
            placed = {kind: factor_name(roles, face, kind) for kind in PLACEMENT if in_chain}
            if wanted.isdisjoint([*names, *placed.values()]):
                continue
            sampled = FaceNodes.of(grid, surface)
            if not wanted.isdisjoint(placed.values()):
                errors |= {placed[kind]: displacement for kind, displacement in displaced(sampled, surface).items()}
            if form in wanted:
                errors[form] = low_order(sampled)
            if waves in wanted:
                errors[waves] = waviness(sampled, *band, _SEED + number)
            if rings in wanted:
                errors[rings] = ripple(sampled, section.ripple_period_mm)
        return PartMaker(tuple(surfaces), roles, errors, spec.base.seat_mm, spec.lens.warmed_by)

    def part(self, deviations: Deviations) -> MadePart:
        """The part with these deviations."""

        def deviation_of(name: str) -> float:
            return float(deviations[name][0]) if name in deviations else 0.0

        def placed(of: str, height: str) -> Pose:
            if height in self.errors:  # it is out of place by its table
                return IN_PLACE
            x, y = deviations.get(f"{of}_shift_mm", _NONE).tolist()
            about_x, about_y = deviations.get(f"{of}_tilt_deg", _NONE).tolist()
            return Pose.displaced((x, y, deviation_of(height)), (about_x, about_y, 0.0))

        index_change, growth = self.warmed_by(deviation_of("temperature_k"))
        made = AsMade(
            names=self.names,
            source=placed("source", "source_height_mm"),
            lens=placed("lens", "lens_height_mm"),
            faces={name: placed(name, factor_name(self.roles, name, "gap_mm")) for name in self.names[1:]},
            source_size=1.0 + deviation_of("source_size"),
            scale=(1.0 + deviation_of("shrinkage")) * growth,
            seat_mm=self.seat_mm,
            slopes={name: self._slope(name, deviations) for name in self.names},
        )
        errors = {name: error for name in self.names if (error := self._error(name, deviations)) is not None}
        return MadePart(errors, made, deviation_of("index") + index_change, 1.0 + deviation_of("source_flux"))

    def _slope(self, face: str, deviations: Deviations) -> float:
        """Rms slope of a face along any line: its roughness, and what of its errors is too fine for the tables."""
        squared = float(deviations[f"{face}_roughness_mrad"][0]) ** 2 if f"{face}_roughness_mrad" in deviations else 0.0
        for name in (f"{face}_waviness_um", f"{face}_ripple_um"):
            if name in self.errors and name in deviations:
                # the numbers of a field are standard normal: their mean square times that of the amount
                squared += float(np.mean(deviations[name] ** 2)) * self.errors[name].slope ** 2
        return float(np.sqrt(squared))

    def _error(self, face: str, deviations: Deviations) -> Float[np.ndarray, "side side"] | None:
        total = None
        for name in (factor_name(self.roles, face, kind) for kind in _IN_CHAINS):
            if name in self.errors and name in deviations and len(self.errors[name].tables):
                error = np.tensordot(deviations[name], self.errors[name].tables, axes=1)
                total = error if total is None else total + error
        return total
