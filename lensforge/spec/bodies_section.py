"""The ``[[bodies]]`` of a spec: given optics in the light behind the lens, such as a dome or a cover, and their places.

They nest like shells: the lens lies in the cavity of the first, each body in that of the next, and every receiver
outside. The search changes none of them, and no file for the shop has them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Annotated

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.optics.face_roles import CAVITY, DOUBLE, OUTSIDE
from lensforge.optics.material import MATERIALS, Material, by_abbe_number
from lensforge.optics.media import FaceCoating, FaceScatter, Media, Medium, SecondaryOptic
from lensforge.optics.pose import Pose
from lensforge.optics.scattering import FacetTurn
from lensforge.public import public
from lensforge.spec.coating_section import CoatingSection
from lensforge.spec.emitter_section import Degrees, Turn
from lensforge.spec.fixed_surface import FixedSurface
from lensforge.spec.lamps_section import Lamps
from lensforge.spec.lens_material import OfMaterial, OpticalData
from lensforge.spec.lens_section import LensShape
from lensforge.spec.scatter_section import AnyScatter
from lensforge.spec.search_section import ConstraintsSection
from lensforge.spec.spec_section import Coordinate, FilePath, Label, Section, check, fault_of
from lensforge.surfaces.placed_bodies import depths, outside_of
from lensforge.surfaces.srbf import fibonacci_hemisphere

_DIRECTIONS = 4000  # in which bodies are compared: 2 degrees apart

_Points = Float[np.ndarray, "n 3"]


@public
class ShellFace(Section):
    """A face of a further body: its shape, about the origin of the body, and its coating."""

    fixed: FixedSurface = Field(description="Surface, in the coordinates of the body: its origin lies within.")
    coating: CoatingSection | None = Field(default=None, description="Coating of the face.")
    scatter: AnyScatter | None = Field(
        default=None, description="How the face spreads the light that passes it; left out, it is polished."
    )


@public
class BodySection(OfMaterial):
    """A given body in the light behind the lens: a dome, a cover, a second optic.

    It stands around the lens, or around the bodies named before it: light comes to it from inside its cavity, meets its
    inner and then its outer face, and is followed to the next body or the receivers. Light that its faces reflect, that
    it absorbs, or that goes past its rim is lost, and counted by its name. The search designs the lens for it, and
    changes nothing of it; what surrounds the lens lies on both of its sides. Its dispersion counts where the lens has
    one, too; temperature and tolerances leave it as it is.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")] = Field(
        description="Name, by which the light that is lost there is stated."
    )
    refractive_index: Annotated[float, Field(ge=1.0, le=4.0)] | None = Field(
        default=None, description="Index at all wavelengths; or leave it out for a dispersive material."
    )
    material: Label | None = Field(
        default=None, description="Name in the catalogue; beside `refractive_index` or other data only a label."
    )
    material_file: FilePath | None = Field(
        default=None, description="File of the material, read into `optical_data` as the spec is; as of the lens."
    )
    optical_data: OpticalData | None = Field(default=None, description="Index and absorption of a custom material.")
    abbe_number: Annotated[float, Field(ge=10.0, le=200.0)] | None = Field(
        default=None, description="Abbe number of a material whose n_d is `refractive_index`: makes it dispersive."
    )
    absorption_per_mm: Annotated[float, Field(ge=0.0, le=10.0)] = Field(
        default=0.0, description="Absorption (Beer and Lambert), if the material itself states none."
    )
    centre_mm: tuple[Coordinate, Coordinate, Coordinate] = Field(
        default=(0.0, 0.0, 0.0), description="Place of its origin in the coordinates of the lens."
    )
    tilt_deg: tuple[Degrees, Degrees] = Field(
        default=(0.0, 0.0), description="Tilt of its axis from +z: about x, then about y."
    )
    rotate_z_deg: Turn = Field(default=0.0, description="Turn about its own axis, before the tilt.")
    inner: ShellFace = Field(description="Face towards the lens, which bounds its cavity.")
    outer: ShellFace = Field(description="Face towards the receivers.")

    @check
    def _has_one_index(self) -> None:
        has_data = self.optical_data is not None
        if has_data and (self.refractive_index is not None or self.abbe_number is not None):
            raise ValueError("refractive_index, abbe_number: the optical_data have their own; leave them out")
        if self.abbe_number is not None and self.refractive_index is None:
            raise ValueError("abbe_number needs refractive_index, the n_d of the same material")
        if not has_data and self.refractive_index is None and self.material not in MATERIALS:
            given = "missing" if self.material is None else f"{self.material!r} is unknown"
            raise ValueError(f"material: {given}; one of {', '.join(MATERIALS)}, or give refractive_index")
        material = self._material
        if material is not None and material.absorption is not None and self.absorption_per_mm > 0.0:
            raise ValueError(f"absorption_per_mm: {self.material} has its own absorption; leave out one of the two")

    @check
    def _has_a_wall(self) -> None:
        u = fibonacci_hemisphere(_DIRECTIONS)
        wall = self.outer.fixed.surface.radius(u) - self.inner.fixed.surface.radius(u)
        worst = int(np.argmin(wall))
        if not wall[worst] > 0.0:
            x, y, z = u[worst]
            raise ValueError(
                f"inner and outer of body {self.name!r} cross: {wall[worst]:.4g} mm between them in the direction "
                f"({x:.3f}, {y:.3f}, {z:.3f}); the inner face must lie within the outer one"
            )

    @property
    def _material(self) -> Material | None:
        if self.optical_data is not None:
            return self.optical_data.material(self.material or self.name)
        if self.refractive_index is None:
            return MATERIALS[str(self.material)]
        name = self.material or self.name
        abbe = self.abbe_number
        return None if abbe is None else by_abbe_number(self.refractive_index, abbe, name)

    @property
    def pose(self) -> Pose:
        """Place of the body in the lens."""
        return Pose.of_tilts(self.centre_mm, self.tilt_deg, self.rotate_z_deg)

    def body(self, design_wavelength_nm: float, outside_index: float = 1.0) -> SecondaryOptic:
        """The body as rays meet it in that index; those without a wavelength have that one.

        Raises :class:`InputError` where its index is not known there.
        """
        material = self._material
        index = self.refractive_index
        absorption = self.absorption_per_mm
        if material is not None:
            index = material.index_at(design_wavelength_nm)
            absorption = material.absorption_at(design_wavelength_nm, absorption)
        assert index is not None, "validated"
        sides = dict(zip(DOUBLE, (CAVITY, OUTSIDE), strict=True))
        coatings = tuple(
            FaceCoating(name, sides[name], face.coating.coating(material or index))
            for name, face in zip(DOUBLE, (self.inner, self.outer), strict=True)
            if face.coating is not None
        )
        return SecondaryOptic(
            self.name,
            Medium(index, absorption, material),
            self.inner.fixed.surface,
            self.outer.fixed.surface,
            self.pose,
            coatings,
            tuple(self._scatter(index / outside_index)),
        )

    def _scatter(self, index: float) -> Iterator[FaceScatter]:
        """Scatter of each face that is not polished; ``index``: of the body against what surrounds it."""
        for name, face, ratio in zip(DOUBLE, (self.inner, self.outer), (1.0 / index, index), strict=True):
            if face.scatter is not None:
                with fault_of(f"{self.name}: {name}.scatter"):
                    model = face.scatter.model(FacetTurn(ratio))
                yield FaceScatter(name, model)


def media_with(bodies: Sequence[BodySection], lens: LensShape) -> Media:
    """The media of the lens with the bodies behind it. Raises :class:`InputError` for an index that is not known."""
    if not bodies:
        return lens.media
    return replace(
        lens.media, bodies=tuple(body.body(lens.design_wavelength_nm, lens.outside_index) for body in bodies)
    )


def require_bodies(sections: Sequence[BodySection], lens: LensShape, limits: ConstraintsSection, lamps: Lamps) -> None:
    """Raise ``ValueError`` for bodies that do not nest about the lens, or reach a cover glass or those of a lamp."""
    if not sections:
        return
    names = [body.name for body in sections]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ValueError(f"bodies: two have the name {twice!r}; give each its own")
    with fault_of("bodies"):
        bodies = media_with(sections, lens).bodies
    _require_within(bodies[0], _largest_lens(lens, limits), "the lens", "lower constraints.max_radius_mm")
    for inner, outer in pairwise(bodies):
        _require_within(outer, outside_of(inner), f"body {inner.name!r}", "give the bodies from the lens on")
    for body in bodies:
        _require_before_glass(body, lens)
        _require_beside_others(body, lamps)


def _require_before_glass(body: SecondaryOptic, lens: LensShape) -> None:
    """Raise ``ValueError`` where a body reaches the cover glass, which stands in front of all bodies."""
    glass = lens.cover_glass
    top_mm = float(outside_of(body)[:, 2].max())
    if glass is not None and glass.distance_mm < top_mm:
        raise ValueError(
            f"lens.cover_glass.distance_mm = {glass.distance_mm:g}: body {body.name!r} reaches z = {top_mm:.4g} mm, "
            "and the glass stands in front of all bodies; move it away"
        )


def _require_beside_others(body: SecondaryOptic, lamps: Lamps) -> None:
    """Raise ``ValueError`` where the bodies of two lamps would overlap."""
    places = outside_of(body)
    wide_mm = 2.0 * float(np.linalg.norm(places if lamps.posed else places[:, :2], axis=1).max())
    if lamps.nearest_mm() < wide_mm:
        raise ValueError(
            f"lamps: the nearest two stand {lamps.nearest_mm():.6g} mm apart, and body {body.name!r} of each reaches "
            f"{0.5 * wide_mm:.4g} mm from its axis; move them apart, or make it smaller"
        )


def _require_within(body: SecondaryOptic, points: _Points, object_name: str, remedy: str) -> None:
    """Raise ``ValueError`` where a point beyond the plane in which the body ends lies out of its cavity."""
    depth = depths(body, points, inner=True)
    worst = int(np.argmin(depth))
    if depth[worst] < 0.0:
        x, y, z = points[worst]
        raise ValueError(
            f"body {body.name!r}: {object_name} may reach {-depth[worst]:.3g} mm out of its cavity, "
            f"at ({x:.3g}, {y:.3g}, "
            f"{z:.3g}) mm; make it larger, move it, or {remedy}"
        )


def _largest_lens(lens: LensShape, limits: ConstraintsSection) -> _Points:
    """Points of the largest lens that the limits allow: a hemisphere, or a cylinder where that is its radius."""
    u = fibonacci_hemisphere(_DIRECTIONS)
    most = limits.max_radius_mm
    if not lens.radius_about_axis:
        return most * u
    height = lens.height_mm(limits)
    across = u[:, :2] / np.linalg.norm(u[:, :2], axis=1, keepdims=True)
    side = np.column_stack([most * across, height * u[:, 2]])
    return np.concatenate([side, np.column_stack([most * u[:, :2], np.full(len(u), height)])])
