"""Bodies and rays as the reference tracer takes them, in torch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Bool, Complex, Float, Int, Int8
from torch import Tensor

from lensforge.kernels.fate import Fate
from lensforge.light.reference_hits import CPU, DrawnTracedFace, ExactFace, TableFace, TracedFace
from lensforge.light.secondary_optics import TWO_FACES, tabled
from lensforge.light.table_trace import Scene, Tables, checked_bounds
from lensforge.optics.dielectric import unpolarised_fields
from lensforge.optics.face_roles import BODY, OUTSIDE
from lensforge.optics.media import Media, Mirror
from lensforge.optics.pose import FacePoses, Pose
from lensforge.scene.body import Chain
from lensforge.scene.made_part import AsMade
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.surface import Surface


@dataclass(frozen=True)
class ReferenceBody:
    """A body whose faces, in the order of the chain, find their own hits.

    ``in_order``: where every ray meets the faces one after another, and what they reflect is lost, as in the usual
    lens. ``placement``: of the faces, where they do not stand in the frame of the rays. ``made``: for their roughness.
    ``origin``: prefix of fields named in errors. ``scatters_before``: number of
    faces that scatter on the bodies before it. ``half_mm``: half of the length of faces that are drawn along y, which
    absorb light at their ends.
    """

    faces: tuple[TracedFace, ...]
    chain: Chain
    media: Media
    in_order: bool = False
    placement: FacePoses | None = None
    made: AsMade | None = None
    origin: str = "lens."
    scatters_before: int = 0
    half_mm: float | None = None

    @staticmethod
    def of_lens(faces: Sequence[TracedFace], scene: Scene, device: torch.device = CPU) -> "tuple[ReferenceBody, ...]":
        """A lens of these faces, in the order of ``scene``, and the optics behind it by their tables on ``device``."""
        placement = None if scene.made is None else scene.made.placed
        chain = scene.chain or TWO_FACES
        drawn = tuple(faces if scene.drawn_half_mm is None else map(DrawnTracedFace, faces))
        in_order = scene.chain is None
        lens = ReferenceBody(drawn, chain, scene.media, in_order, placement, scene.made, half_mm=scene.drawn_half_mm)
        return lens, *(_of_optic(number, scene.media, device) for number in range(len(scene.media.bodies)))

    @staticmethod
    def by_tables(
        tables: Float[Tensor, "f side side"], scene: Scene, device: torch.device = CPU
    ) -> "tuple[ReferenceBody, ...]":
        """The lens of these tables on ``device``, differentiable in them, and the optics behind it.

        Raises :class:`InputError` for a radius that is not positive.
        """
        bounds = checked_bounds(tables.detach().numpy(), scene)
        faces = [TableFace.of(table, scene.grid, bound, device) for table, bound in zip(tables, bounds, strict=True)]
        return ReferenceBody.of_lens(faces, scene, device)

    @staticmethod
    def exact(
        surfaces: Mapping[str, Surface], scene: Scene, guides: Tables | None = None
    ) -> "tuple[ReferenceBody, ...]":
        """The lens of these surfaces by name, and the optics behind it.

        ``guides``: tables of ``scene`` by which hits are found, where faces are met in their order.
        """
        shapes = [surfaces[name] for name in scene.names]
        if guides is None:
            return ReferenceBody.of_lens([ExactFace.of(shape) for shape in shapes], scene)
        tables = (TableFace.of(torch.from_numpy(table), scene.grid) for table in guides)
        return ReferenceBody.of_lens(
            [ExactFace.of(*shape_and_table) for shape_and_table in zip(shapes, tables, strict=True)], scene
        )

    def bounding(self, medium: str, behind: tuple[str, ...] = (BODY, OUTSIDE)) -> list[int]:
        """Numbers of the faces that bound ``medium`` on the side away from the origin, towards one of ``behind``."""
        sides = enumerate(zip(self.chain.before, self.chain.behind, strict=True))
        return [number for number, (before, other) in sides if before == medium and other in behind]

    def mirror(self, number: int) -> float | None:
        """Reflectance of the mirror on a face; None if it has none."""
        coating = self.media.coating(self.chain.names[number])
        return coating.reflectance if isinstance(coating, Mirror) else None


def _of_optic(number: int, around: Media, device: torch.device) -> ReferenceBody:
    optic = around.bodies[number]
    before = around.scattering_before(number)
    place = tabled(optic)
    origin = f"body {optic.name!r}: "
    faces = tuple(TableFace.of(torch.from_numpy(table), place.grid, device=device) for table in place.tables)
    media = optic.media(around)
    return ReferenceBody(faces, TWO_FACES, media, True, place.placement, origin=origin, scatters_before=before)


class RaysInBody(NamedTuple):
    """Rays of a bundle by their ``numbers``, after an event.

    ``fields``: two, of which half of the squared length is left of the flux ``carried`` (W). ``absorbed``: W. ``last``:
    number of the face last met, below 0 before. ``gone_mm``: path since then. ``times``: how often each ray has met
    each face of its present body.
    """

    numbers: Int[Tensor, " n"]
    points: Float[Tensor, "n 3"]
    directions: Float[Tensor, "n 3"]
    fields: Complex[Tensor, "n 2 3"]
    carried: Float[Tensor, " n"]
    absorbed: Float[Tensor, " n"]
    sin2_exit: Float[Tensor, " n"]
    last: Int[Tensor, " n"]
    gone_mm: Float[Tensor, " n"]
    fates: Int8[Tensor, " n"]
    times: Int[Tensor, "n f"]

    @staticmethod
    def emitted(rays: RayBundle, device: torch.device) -> "RaysInBody":
        """Unpolarised rays as they leave a source."""
        points, directions, flux = (
            torch.tensor(array, dtype=torch.float64, device=device)
            for array in (rays.origins, rays.directions, rays.flux)
        )
        numbers = torch.arange(len(flux), device=device)
        none = torch.zeros_like(flux)
        known = torch.isfinite(directions).all(dim=1)[:, None]  # any other ray meets nothing, and keeps its flux
        field_pairs = unpolarised_fields(torch.where(known, directions, directions.new_tensor([0.0, 0.0, 1.0]))) + 0.0j
        no_face = -1 - 0 * numbers
        fates = none.to(torch.int8)
        return RaysInBody(
            numbers, points, directions, field_pairs, flux, none, none, no_face, none, fates, 0 * numbers[:, None]
        )

    @staticmethod
    def joined(parts: "Sequence[RaysInBody]") -> "RaysInBody":
        """The rays of all parts, one after another."""
        return RaysInBody(*map(torch.cat, zip(*parts, strict=True)))

    def take(self, rows: Tensor) -> "RaysInBody":
        """Select rays by row."""
        return RaysInBody(*(values[rows] for values in self))

    def ended(self, fate: Fate) -> "RaysInBody":
        """The rays with this fate."""
        return self._replace(fates=torch.full_like(self.fates, int(fate)))

    def placed(self, pose: Pose, factor: float = 1.0) -> "RaysInBody":
        """The rays in the frame of the next body."""
        points = pose.points(self.points, factor)
        directions = pose.directions(self.directions)
        return self._replace(points=points, directions=directions, fields=pose.directions(self.fields))

    @property
    def left(self) -> Bool[Tensor, " n"]:
        """True for rays that have left the body, or are still on their way."""
        return self.fates == Fate.LEFT_LENS

    @property
    def flux(self) -> Float[Tensor, " n"]:
        """Flux (W)."""
        return 0.5 * self.carried * _squares(self.fields).sum(dim=(1, 2))

    @property
    def axial_flux(self) -> Float[Tensor, " n"]:
        """Flux (W) times the squared axial component of the unit field."""
        return 0.5 * self.carried * _squares(self.fields[:, :, 2]).sum(dim=1)


def _squares(values: Complex[Tensor, "*n"]) -> Float[Tensor, "*n"]:
    return values.real.square() + values.imag.square()
