"""The media that a ray passes: what fills the cavity, the body of the lens, what surrounds it, and optics before it.

A ray has its wavelength; a medium answers what index and absorption it has there. Each face between media may carry a
coating, which replaces Fresnel's reflectance.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from lensforge.kernels.parallel import in_chunks
from lensforge.optics.face_roles import CAVITY, OUTSIDE, SHELL, FaceRole, bounding
from lensforge.optics.material import Material
from lensforge.optics.pose import IN_PLACE, Pose
from lensforge.optics.scattering import GaussianFacets
from lensforge.optics.scattering import RingScatter as RingScatter  # the proof reads it here
from lensforge.public import public


@dataclass(frozen=True)
class IndexCurve:
    """Refractive index at ``wavelengths_nm`` (rising), linear between them; without them constant."""

    refractive_index: tuple[float, ...]
    wavelengths_nm: tuple[float, ...] = ()

    def at(self, wavelengths_nm: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Index at each wavelength; outside the curve that of its nearer end."""
        if not self.wavelengths_nm:
            return np.full(len(wavelengths_nm), self.refractive_index[0])
        return np.interp(wavelengths_nm, self.wavelengths_nm, self.refractive_index)


@dataclass(frozen=True)
class ReflectanceTable:
    """Unpolarised reflectance of a coated face by wavelength and by angle in the less dense medium (degrees, from 0).

    Over the cosine of the angle a monotone cubic (Fritsch and Carlson), up to 1 at 90 degrees where the table ends
    before; linear between ``wavelengths_nm`` (rising), or without them one row for all.
    """

    angles_deg: tuple[float, ...]
    reflectance: tuple[tuple[float, ...], ...]
    wavelengths_nm: tuple[float, ...] = ()


@dataclass(frozen=True)
class CoatingLayer:
    """A non-absorbing layer of a coating."""

    index: IndexCurve
    thickness_nm: float


@dataclass(frozen=True)
class LayerStack:
    """Layers of a coated face, the outermost first; they interfere coherently, the body does not.

    ``body``: index of the body by wavelength. All indices are known over ``range_nm``.
    """

    layers: tuple[CoatingLayer, ...]
    body: IndexCurve
    range_nm: tuple[float, float]


@dataclass(frozen=True)
class Mirror:
    """A metal film: it reflects ``reflectance`` at every angle, in either polarisation, and absorbs the rest.

    With 0 it is the end of all light that meets it, a fate of its own.
    """

    reflectance: float


Film = ReflectanceTable | LayerStack
Coating = Film | Mirror


@dataclass(frozen=True)
class CoverGlass:
    """A plane-parallel plate across the axis, as wide as the light, its near face at z = ``distance_mm``.

    The medium around the lens is on both sides. ``absorption_per_mm``: by the law of Beer and Lambert. ``coating``: of
    both faces.
    """

    refractive_index: float
    thickness_mm: float
    distance_mm: float
    absorption_per_mm: float = 0.0
    coating: Film | None = None


_Rows = np.ndarray | slice  # numbers, a mask
_Values = tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"] | None]


@dataclass(eq=False)
class Wavelengths:
    """Constant wavelengths (nm) of rays, with cached index and absorption of the last material.

    The same rays go through part after part, and every step of a search takes some of the same file: a formula of many
    powers takes half as long as their trace. ``chosen_from``: wavelengths that have the cached values, and the rows
    among them.
    """

    nm: Float[np.ndarray, " n"]
    chosen_from: "tuple[Wavelengths, _Rows] | None" = None
    answer: tuple[Material, _Values] | None = None

    def take(self, rows: _Rows) -> "Wavelengths":
        """Wavelengths of some of the rays."""
        return Wavelengths(self.nm[rows], (self, rows))

    def __reduce__(self) -> tuple[type["Wavelengths"], tuple[Float[np.ndarray, " n"]]]:
        """Only the wavelengths, for another process."""
        return Wavelengths, (self.nm,)

    def values_of(self, material: Material) -> _Values:
        """Index of ``material`` at each wavelength, and its absorption (1/mm) if stated."""
        if self.answer is None or self.answer[0] != material:
            self.answer = material, self._computed(material)
        return self.answer[1]

    def _computed(self, material: Material) -> _Values:
        if self.chosen_from is not None:
            source, rows = self.chosen_from
            indices, absorptions = source.values_of(material)
            return indices[rows], None if absorptions is None else absorptions[rows]
        indices = np.empty(len(self.nm))

        def work(_: int, part: slice) -> None:
            indices[part] = material.nearest_index(self.nm[part])

        in_chunks(work, len(self.nm))
        return indices, None if material.absorption is None else material.absorption.at(self.nm)


@dataclass(frozen=True)
class Medium:
    """A medium's refractive index, and its absorption (1/mm) by the law of Beer and Lambert.

    Both are for rays without a wavelength; with ``material`` other rays have its index at theirs, and its absorption if
    stated. ``index_error``: error of a part's index, at every wavelength.
    """

    refractive_index: float
    absorption_per_mm: float = 0.0
    material: Material | None = None
    index_error: float = 0.0

    def index(self, waves: Wavelengths | None) -> Float[np.ndarray, " k"]:
        """Index for each ray; a single one if no ray has a wavelength, or if it does not matter."""
        if waves is None or self.material is None:
            return np.array([self.refractive_index + self.index_error])
        indices = waves.values_of(self.material)[0]
        return indices if self.index_error == 0.0 else indices + self.index_error

    def absorption(self, waves: Wavelengths | None) -> Float[np.ndarray, " k"]:
        """Absorption (1/mm) for each ray, or one for all; empty if the medium is clear."""
        if waves is not None and self.material is not None:
            of_material = waves.values_of(self.material)[1]
            if of_material is not None:
                return of_material
        return np.full(int(self.absorption_per_mm > 0.0), self.absorption_per_mm)

    def indices(self, waves: Wavelengths | None, count: int) -> Float[np.ndarray, " n"]:
        """Index for each of ``count`` rays."""
        return _of_each(self.index(waves), count)

    def absorptions(self, waves: Wavelengths | None, count: int) -> Float[np.ndarray, " n"]:
        """Absorption (1/mm) for each of ``count`` rays, 0 if the medium is clear."""
        return _of_each(self.absorption(waves), count)


def _of_each(values: Float[np.ndarray, " k"], count: int) -> Float[np.ndarray, " n"]:
    """``values`` for ``count`` rays, from one for each, one for all, or none: 0."""
    return values if len(values) == count else np.full(count, values[0] if len(values) else 0.0)


# Of opaque bodies of a scene: "diffuse" if any of them is, else "mirror".
Reflection = Literal["diffuse", "mirror"]


@dataclass(frozen=True)
class FaceCoating:
    """Coating of the face ``name``; ``around``: the medium opposite the body, CAVITY or OUTSIDE."""

    face: str
    around: str
    coating: Coating


@dataclass(frozen=True)
class FaceScatter:
    """Scatter of the face ``name``, by facets or by rings."""

    face: str
    model: GaussianFacets | RingScatter


@public
@runtime_checkable
class Surface(Protocol):
    """A star-shaped surface about its local origin, defined by radius and gradient: all else follows.

    ``directions`` are unit vectors, also a little below z = 0. The kinds of it are in the room above, ``surfaces``.
    """

    @property
    def detail_rad(self) -> float:
        """Sigma (rad) of a Gaussian as narrow as its narrowest feature: tables and splines choose nodes by it."""
        ...

    @property
    def symmetry(self) -> str:
        """Largest mirror group (a name of ``surfaces.mirror_group``) that it is known to have."""
        return "none"

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """``rho`` (mm), the distance from the origin, exact in float64."""
        ...

    def gradient(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Tangential gradient of ``rho`` on the unit sphere (mm/rad), orthogonal to ``directions``."""
        ...

    def radius_on_grid(self, directions: Float[np.ndarray, "n n 3"]) -> Float[np.ndarray, "n n"]:
        """``rho`` (mm) on a square chart grid centred on the axis; a surface with mirror images may use them."""
        return self.radius(directions.reshape(-1, 3)).reshape(directions.shape[:2])

    def radius_and_gradient(
        self, directions: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
        """Radius and gradient, which a surface may compute faster together."""
        return self.radius(directions), self.gradient(directions)

    def normal(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Unit normals pointing away from the origin: ``u - grad(rho)/rho``, normalised."""
        radius, gradient = self.radius_and_gradient(directions)
        outward = directions - gradient / radius[:, None]
        return outward / np.linalg.norm(outward, axis=1, keepdims=True)


@dataclass(frozen=True)
class SecondaryOptic:
    """A body in the light behind the lens, such as a dome, with the medium around the lens on both sides.

    Light comes to it from its cavity, within ``inner``, and leaves by ``outer``. It ends in the plane z = 0 of its own
    frame, which stands in that of the lens by ``pose``. ``coatings``: of its faces, which have the names of those of a
    double-freeform lens.
    """

    name: str
    medium: Medium
    inner: Surface
    outer: Surface
    pose: Pose = IN_PLACE
    coatings: tuple[FaceCoating, ...] = ()
    scatter: tuple[FaceScatter, ...] = ()

    def media(self, around: "Media") -> "Media":
        """Its media, within the surroundings of a lens of the media ``around``."""
        outside = around.outside_index
        wavelength_nm = around.wavelength_nm
        return Media(
            self.medium, outside, outside, coatings=self.coatings, wavelength_nm=wavelength_nm, scatter=self.scatter
        )


@dataclass(frozen=True)
class Media:
    """The body of the lens, the indices in its cavity and around it (1 is air), and the optics behind it.

    ``bodies``: the optics, in the order in which light meets them. ``coatings``: of the body's faces, at most one of
    each. ``wavelength_nm``: of rays without their own, where a coating depends on it. ``faces``: of the body.
    ``scatter``: of its faces that are not polished. ``walls``: how opaque bodies of the scene reflect light; None if
    none does. ``wall_events``: the most of them from which light goes on.
    """

    body: Medium
    cavity_index: float = 1.0
    outside_index: float = 1.0
    cover_glass: CoverGlass | None = None
    coatings: tuple[FaceCoating, ...] = ()
    wavelength_nm: float = 587.5618  # the He d line
    bodies: tuple[SecondaryOptic, ...] = ()
    faces: tuple[FaceRole, ...] = SHELL
    scatter: tuple[FaceScatter, ...] = ()
    walls: Reflection | None = None
    wall_events: int = 1

    def __post_init__(self) -> None:
        """Raise :class:`ValueError` for a coating of a face that the body does not have: it would be ignored."""
        names = {face.name for face in self.faces}
        if not {coating.face for coating in self.coatings} <= names:
            raise ValueError(
                f"coatings of {[coating.face for coating in self.coatings]}, and the faces are {sorted(names)}"
            )

    def coating(self, face: str) -> Coating | None:
        """Coating of ``face``; None for a bare one."""
        return next((coating.coating for coating in self.coatings if coating.face == face), None)

    def scattering_of(self, faces: Sequence[str]) -> tuple[GaussianFacets | RingScatter | None, ...] | None:
        """Scatter of each of the ``faces``; None if all are polished."""
        known = {scatter.face: scatter.model for scatter in self.scatter}
        return tuple(map(known.get, faces)) if known else None

    @property
    def has_rings(self) -> bool:
        """True if a face of the body scatters by rings."""
        return any(isinstance(scatter.model, RingScatter) for scatter in self.scatter)

    @property
    def spreads(self) -> bool:
        """True if rings turn light transmitted by a face of the body farther than refraction can."""
        mirrors = {coating.face for coating in self.coatings if isinstance(coating.coating, Mirror)}
        return any(isinstance(scatter.model, RingScatter) and scatter.face not in mirrors for scatter in self.scatter)

    def scattering_before(self, body: int) -> int:
        """Number of faces that scatter on the lens and on the bodies before number ``body``."""
        return len(self.scatter) + sum(len(optic.scatter) for optic in self.bodies[:body])

    @property
    def scattering(self) -> int:
        """Number of surfaces that scatter: faces, including those of the bodies, then one for each event at walls."""
        return self.scattering_before(len(self.bodies)) + self.diffusing

    @property
    def diffusing(self) -> int:
        """Number of events at walls of the scene for which a ray needs numbers: all if a wall is diffuse, else none."""
        return self.wall_events if self.walls == "diffuse" else 0

    @property
    def polished(self) -> "Media":
        """The same media with polished faces, including those of the bodies."""
        bodies = tuple(replace(body, scatter=()) for body in self.bodies)
        return replace(self, scatter=(), bodies=bodies)

    @property
    def exit_mirror(self) -> Mirror | None:
        """Mirror of a reflector, by which light leaves unless it leaves directly; None for a lens."""
        if not any(face.is_open for face in self.faces):
            return None
        coatings = (self.coating(face.name) for face in bounding(self.faces, CAVITY))
        return next((coating for coating in coatings if isinstance(coating, Mirror)), None)

    def around(self, medium: str) -> float:
        """Index of what lies around the body: CAVITY or OUTSIDE."""
        return {CAVITY: self.cavity_index, OUTSIDE: self.outside_index}[medium]

    def wavelengths(self, wavelengths_nm: Float[np.ndarray, " n"] | None, count: int) -> Float[np.ndarray, " n"]:
        """Wavelength (nm) of each of ``count`` rays: its own, or that of ``wavelength_nm``."""
        return np.full(count, self.wavelength_nm) if wavelengths_nm is None else wavelengths_nm

    @property
    def coated(self) -> bool:
        """True if a face carries a film, including the cover glass; a mirror is none."""
        films = [coating for coating in self.coatings if not isinstance(coating.coating, Mirror)]
        glass = self.cover_glass
        return bool(films) or (glass is not None and glass.coating is not None)

    @property
    def largest_turning_power(self) -> float:
        """Larger index step of the two faces: a facet of slope s turns light by about s times it."""
        index = self.body.refractive_index
        return max(abs(index - self.cavity_index), abs(index - self.outside_index))

    @property
    def spread_rad(self) -> float:
        """Rms angle along a line by which the roughest face spreads light; 0 if all are polished."""
        models = [scatter.model for scatter in self.scatter]
        power = self.largest_turning_power
        spreads = (model.rms if isinstance(model, RingScatter) else power * model.slope for model in models)
        return max(spreads, default=0.0)

    @property
    def etendue_factor(self) -> float:
        """Étendue (mm^2 sr) of light outside over that in the cavity: n^2 times étendue is conserved."""
        return (self.cavity_index / self.outside_index) ** 2
