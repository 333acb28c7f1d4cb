"""Sources built from the ``[source]`` of a spec; modules that one kind needs are loaded for that kind only.

The paper's source, a square Lambertian emitter in the plane z = 0, needs none. Any source may stand in a place of its
own, and around it lies a smallest cavity of usual proportions.
"""

from dataclasses import dataclass, replace
from functools import cached_property, singledispatch

import numpy as np
from jaxtyping import Float

from lensforge import seeds
from lensforge.errors import InputError
from lensforge.optics.material import Material
from lensforge.optics.pose import ALONG_Z, Pose
from lensforge.seeds import sobol
from lensforge.sources.dispersion import ColouredSource
from lensforge.sources.radiance_emitter import radiance_emitter
from lensforge.sources.ray_bundle import ChangedSource, RayBundle, Source, aimed
from lensforge.sources.ray_colours import TristimulusSource, tristimulus_of_spectrum
from lensforge.sources.source_flux import chip_fluxes, emitter_flux
from lensforge.sources.source_spectrum import spectrum_of
from lensforge.sources.source_summary import SourceSummary
from lensforge.spec.derived_values import CAVITY_HEIGHT, rounded_length
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.source_sections import ChipsSource, PlanarSource, RadianceSource, RaySetSource, SquareSource
from lensforge.surfaces.mirror_group import group, largest_symmetry

_OF_RAYS = 4  # dimensions of a sample of rays
_MOST_FACETS = 2  # rough faces for which the sequence has further dimensions
_SAME = 1e-12  # elements of a rotation by 45 degrees, rounded, are this close to those of a mirror


@dataclass(frozen=True)
class SquareEmitter:
    """Uniform, Lambertian, ``side_mm`` wide, centred on the axis; total flux ``flux_w``. ``side_mm = 0``: a point."""

    side_mm: float
    flux_w: float = 1.0
    symmetry: str = "square"
    ray_count: int | None = None

    def sample(self, count: int, seed: int) -> RayBundle:
        """Draw ``count`` rays of equal flux: position uniform, direction cosine-distributed (Malley's method)."""
        if count < 1:
            raise InputError(f"{count} rays: at least 1")
        points = sobol(count, 4, seed)
        origins = np.zeros((count, 3))
        for axis in (0, 1):
            origins[:, axis] = (points[:, axis] - 0.5) * self.side_mm
        # Owen-scrambled points lie in [0, 1): 1 - u keeps the cosine above zero, so no ray grazes the chip.
        sine = np.sqrt(points[:, 2])
        azimuth = 2.0 * np.pi * points[:, 3]
        directions = np.empty((count, 3))
        np.multiply(sine, np.cos(azimuth), out=directions[:, 0])
        np.multiply(sine, np.sin(azimuth), out=directions[:, 1])
        np.sqrt(1.0 - points[:, 2], out=directions[:, 2])
        return RayBundle(origins, directions, np.full(count, self.flux_w / count))

    def radiances(self, count: int, seed: int) -> Float[np.ndarray, " n"]:
        """Radiance (W/(mm^2 sr)) of each ray of a sample: equal in all places and directions."""
        area = np.pi * self.side_mm**2
        return np.full(count, self.flux_w / area if area > 0.0 else np.inf)

    def towards(self, targets: Float[np.ndarray, "n 3"], seed: int) -> RayBundle:
        """The rays of a sample, each turned to its target (mm); their flux is W/sr there: Lambert's cosine."""
        rays = self.sample(len(targets), seed)
        return aimed(rays, targets, lambda along: np.maximum(along[:, 2], 0.0) / np.pi)

    def outline(self) -> Float[np.ndarray, "4 3"]:
        """Corners (mm) of the square."""
        half = self.side_mm / 2.0
        return np.array([[-half, -half, 0.0], [half, -half, 0.0], [half, half, 0.0], [-half, half, 0.0]])


@dataclass(frozen=True, eq=False)
class PlacedSource(ChangedSource):
    """``source``, which emits about its local origin, at ``pose`` in the lens."""

    pose: Pose

    @cached_property
    def symmetry(self) -> str:
        """Largest mirror group about the lens axis that maps the placed source onto itself."""
        return largest_symmetry(self._keeps)

    def _keeps(self, mirror: Float[np.ndarray, "3 3"]) -> bool:
        """True if a mirror leaves the pose unchanged and is one of the source's own."""
        if not np.array_equal(mirror @ self.pose.origin_mm, self.pose.origin_mm):
            return False
        local_mirror = self.pose.to_local_map(mirror)
        return any(np.allclose(local_mirror, image, rtol=0.0, atol=_SAME) for image in group(self.source.symmetry))

    @property
    def is_round(self) -> bool:
        """True if the pose only shifts the source along the axis and turns it about the axis."""
        return super().is_round and not any(self.pose.origin_mm[:2]) and self.pose.axis == ALONG_Z

    def changed_rays(self, rays: RayBundle, seed: int) -> RayBundle:
        """The rays, moved."""
        return rays.placed(self.pose)

    def towards(self, targets: Float[np.ndarray, "n 3"], seed: int) -> RayBundle:
        """The rays of a sample, each turned to its target (mm); their flux is W/sr there."""
        return super().towards(self.pose.to_local_points(targets), seed)

    def outline(self) -> Float[np.ndarray, "k 3"]:
        """Outline (mm) of the source, in the lens."""
        return self.pose.points(self.source.outline())


@dataclass(frozen=True, eq=False)
class FacetedSource(ChangedSource):
    """``source`` whose rays also have random numbers for the facets of ``faces`` rough faces, at most two.

    They are further dimensions of the Sobol sequence that draws the rays: each dimension is scrambled independently.
    """

    faces: int

    def changed_rays(self, rays: RayBundle, seed: int) -> RayBundle:
        """The rays with their numbers."""
        return replace(rays, facets=sobol(len(rays), _OF_RAYS + 2 * self.faces, seeds.of_facets(seed), _OF_RAYS))


def build_source(
    spec: EmitterSection, material: Material | None = None, *, coloured: bool = False, facets: int = 0
) -> Source:
    """Build the emitter that ``spec`` describes. Raises :class:`InputError` for a file that cannot be used.

    ``material``: of the lens if it is dispersive; then rays carry their wavelengths, if known, and :class:`InputError`
    is also raised if its index is not known at them. ``coloured``: rays carry X, Y and Z per W, and :class:`InputError`
    is raised if a spectrum is unknown or invisible. ``facets``: number of rough faces, for which rays that are not
    measured have random numbers.
    """
    if isinstance(spec, RaySetSource):
        from lensforge.sources.ray_set_loading import load_ray_set

        rays = load_ray_set(spec, material, colours=coloured)
        if spec.model == "rays":
            return rays
        from lensforge.sources.modelled_rays import modelled

        return modelled(rays, spec.model)
    emitter = emitter_of(spec, disperses=material is not None, coloured=coloured)
    pose = spec.pose
    if facets:
        emitter = FacetedSource(emitter, min(facets, _MOST_FACETS))
    if pose.moves:
        emitter = PlacedSource(emitter, pose)
    if material is not None and isinstance(spec, ChipsSource) and spec.spectra:
        parts = zip(spec.spectra, chip_fluxes(spec), strict=True)
        known = [(spectrum_of(emitter), flux.flux_w) for emitter, flux in parts if emitter is not None]
        emitter = ColouredSource.of_parts(emitter, known, material)
    elif material is not None and spec.spectrum is not None:
        emitter = ColouredSource.of(emitter, spectrum_of(spec.spectrum), material)
    if not coloured:
        return emitter
    return TristimulusSource(emitter, None if spec.spectra else tristimulus_of_spectrum(spec.spectrum, "source"))


@singledispatch
def emitter_of(spec: EmitterSection, *, disperses: bool, coloured: bool) -> Source:
    """The emitter that ``spec`` describes, at the origin and along +z. A kind of source registers its function here.

    A planar source with one intensity profile needs none: :func:`planar_emitter.area_of` is enough. ``disperses``,
    ``coloured``: rays of parts with spectra of their own shall carry wavelengths, or X, Y and Z per W.
    """
    from lensforge.sources.planar_emitter import planar_emitter

    if not isinstance(spec, PlanarSource):
        raise NotImplementedError(f"no emitter of kind {spec.kind}: register a function with emitter_of")
    return planar_emitter(spec, disperses=disperses, coloured=coloured)


emitter_of.register(SquareSource, lambda spec, **_: SquareEmitter(spec.side_mm, emitter_flux(spec).flux_w))
emitter_of.register(RadianceSource, lambda spec, **_: radiance_emitter(spec))


def summarise(source: Source, spec: EmitterSection) -> SourceSummary:
    """Summary of ``source``, built from ``spec``; of a ray set also its files, and their processing."""
    if isinstance(source, TristimulusSource):
        return summarise(source.source, spec)
    if isinstance(source, ColouredSource):
        plain = summarise(source.source, spec)
        warnings = (*plain.warnings, *source.warnings)
        return plain.changed(**source.index_range.fields(), warnings=warnings)
    known = getattr(source, "summary", None)  # ray sets have one; their module is loaded for them alone
    if isinstance(known, SourceSummary):
        return known
    flux = emitter_flux(spec, source.flux_w)
    return SourceSummary(
        title=spec.title,
        flux_w=source.flux_w,
        lumens_per_watt=flux.lumens_per_watt,
        symmetry=source.symmetry,
        warnings=(*_file_warnings(source), *flux.warnings),
    )


def _file_warnings(source: Source) -> tuple[str, ...]:
    if isinstance(source, PlacedSource | FacetedSource):
        return _file_warnings(source.source)
    return getattr(source, "warnings", ())  # of a planar emitter; its module is loaded for it alone


_RAYS = 2**16
_SEED = 0
_INSIDE = 0.99  # share of the flux; the rest is stray light from package and window
_ROOM = 1.05  # over the paraboloid that just holds it


def cavity_around(spec: EmitterSection) -> dict[str, float]:
    """Height and radius (mm) of the paraboloid inside which 99 % of the flux starts, as fields of the constraints.

    Raises :class:`InputError` for a file that cannot be used.
    """
    radius = cavity_radius(build_source(spec))
    return {"cavity_height_mm": rounded_length(CAVITY_HEIGHT * radius), "cavity_radius_mm": rounded_length(radius)}


def cavity_radius(source: Source) -> float:
    """Radius (mm) of that paraboloid at z = 0.

    A point (r, z) lies on the paraboloid z = h (1 - r^2/R^2) with h = c R where R = (z/c + sqrt((z/c)^2 + 4 r^2)) / 2.
    """
    rays = source.sample(min(_RAYS, source.ray_count or _RAYS), _SEED)
    x, y, z = rays.origins.T
    height = np.maximum(z, 0.0) / CAVITY_HEIGHT
    needed = 0.5 * (height + np.sqrt(height**2 + 4.0 * (x**2 + y**2)))
    order = np.argsort(needed)
    inside = np.cumsum(rays.flux[order]) / rays.flux.sum()
    return _ROOM * float(needed[order[min(int(np.searchsorted(inside, _INSIDE)), len(order) - 1)]])
