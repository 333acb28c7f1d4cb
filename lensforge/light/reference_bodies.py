"""Bodies and rays as the reference tracer takes them, in torch."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Complex, Float, Int, Int8
from torch import Tensor

from lensforge.kernels.fate import Fate
from lensforge.light.reference_hits import CPU, ExactFace, TableFace, TracedFace
from lensforge.light.secondary_optics import TWO_FACES, tabled
from lensforge.light.table_trace import Scene, Tables, checked_bounds
from lensforge.optics.arrays import like
from lensforge.optics.dielectric import unpolarised_fields
from lensforge.optics.media import BODY, OUTSIDE, Media, Mirror, SecondaryOptic
from lensforge.scene.as_made import AsMade, through_frame
from lensforge.scene.body import Chain
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.surface import Surface

Frame = tuple[Float[np.ndarray, "3 4"], float]  # a rotation and a shift (mm) into the next frame, a factor of lengths


@dataclass(frozen=True)
class ReferenceBody:
    """A body whose faces, in the order of the chain, find their own hits.

    ``in_order``: where every ray meets the faces one after another, and what they reflect is lost, as in the usual
    lens. ``made``: where the body is not as designed. ``pose``: of a body behind the lens.
    """

    faces: tuple[TracedFace, ...]
    chain: Chain
    media: Media
    in_order: bool = False
    made: AsMade | None = None
    pose: SecondaryOptic | None = None

    @staticmethod
    def by_tables(
        tables: Float[Tensor, "f side side"], scene: Scene, device: torch.device = CPU
    ) -> "tuple[ReferenceBody, ...]":
        """The lens of these tables on ``device``, differentiable in them, and the bodies behind it by theirs.

        Raises :class:`InputError` for a radius that is not positive.
        """
        bounds = checked_bounds(tables.detach().numpy(), scene)
        faces = (TableFace.of(table, scene.grid, own, device) for table, own in zip(tables, bounds, strict=True))
        lens = ReferenceBody(tuple(faces), scene.chain or TWO_FACES, scene.media, scene.chain is None, scene.made)
        return lens, *_behind_lens(scene.media, device)

    @staticmethod
    def exact(
        surfaces: Mapping[str, Surface], scene: Scene, guides: Tables | None = None
    ) -> "tuple[ReferenceBody, ...]":
        """The lens of these surfaces by name, and the bodies behind it by their tables.

        ``guides``: tables of ``scene`` by which hits are found, where faces are met in their order.
        """
        shapes = [surfaces[name] for name in scene.names]
        if guides is None:
            faces = [ExactFace.of(shape) for shape in shapes]
        else:
            tables = (TableFace.of(torch.from_numpy(table), scene.grid) for table in guides)
            faces = [ExactFace.of(shape, table) for shape, table in zip(shapes, tables, strict=True)]
        lens = ReferenceBody(tuple(faces), scene.chain or TWO_FACES, scene.media, scene.chain is None, scene.made)
        return lens, *_behind_lens(scene.media, CPU)

    @property
    def frames(self) -> tuple[Frame, Frame] | None:
        """The frame of the first face, from that before the body, and the one behind it from that of the last face."""
        if self.made is not None:
            frames, into, back = self.made.placed
            return (frames[0], into), (frames[-1], back)
        if self.pose is not None:
            turn, centre = np.array(self.pose.turn), np.array(self.pose.centre_mm)
            return (np.column_stack([turn.T, -centre @ turn]), 1.0), (np.column_stack([turn, centre]), 1.0)
        return None

    def bounding(self, medium: str, behind: tuple[str, ...] = (BODY, OUTSIDE)) -> list[int]:
        """Numbers of the faces that bound a medium on the side away from the origin, with one of these ``behind``."""
        sides = enumerate(zip(self.chain.before, self.chain.behind, strict=True))
        return [number for number, (before, other) in sides if before == medium and other in behind]

    def mirror(self, number: int) -> float | None:
        """Reflectance of the mirror on a face; None where it has none."""
        coating = self.media.coating(self.chain.names[number])
        return coating.reflectance if isinstance(coating, Mirror) else None


def _behind_lens(media: Media, device: torch.device) -> Iterator[ReferenceBody]:
    """The bodies behind the lens, by tables that are within a nanometre of their faces."""
    for body in media.bodies:
        place = tabled(body)
        faces = tuple(TableFace.of(torch.from_numpy(table), place.grid, device=device) for table in place.tables)
        yield ReferenceBody(faces, TWO_FACES, body.media(media), in_order=True, pose=body)


class RaysInBody(NamedTuple):
    """Rays of a bundle by their ``numbers``, as events leave them.

    ``fields``: two, of which half of the squared length is left of the flux ``carried`` (W). ``absorbed``: W.
    ``last``: number of the face last met, below 0 before. ``gone_mm``: way since then that lies behind the ray.
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

    @staticmethod
    def emitted(rays: RayBundle, device: torch.device) -> "RaysInBody":
        """Unpolarised rays as they leave a source."""
        points, directions, flux = (
            torch.tensor(array, dtype=torch.float64, device=device)
            for array in (rays.origins, rays.directions, rays.flux)
        )
        numbers, none = torch.arange(len(flux), device=device), torch.zeros_like(flux)
        known = torch.isfinite(directions).all(dim=1)[:, None]  # any other ray meets nothing, and keeps its flux
        field_pairs = unpolarised_fields(torch.where(known, directions, directions.new_tensor([0.0, 0.0, 1.0]))) + 0.0j
        return RaysInBody(
            numbers, points, directions, field_pairs, flux, none, none, -1 - 0 * numbers, none, none.to(torch.int8)
        )

    @staticmethod
    def joined(parts: "Sequence[RaysInBody]") -> "RaysInBody":
        """The rays of all parts, one after another."""
        return RaysInBody(*map(torch.cat, zip(*parts, strict=True)))

    def take(self, rows: Tensor) -> "RaysInBody":
        """Some of the rays."""
        return RaysInBody(*(each[rows] for each in self))

    def ended(self, fate: Fate) -> "RaysInBody":
        """The rays with this fate."""
        return self._replace(fates=torch.full_like(self.fates, int(fate)))

    def turned(self, frame: Float[np.ndarray, "3 4"], factor: float = 1.0) -> "RaysInBody":
        """The rays in the next frame."""
        points, directions = through_frame(frame, self.points, self.directions, factor)
        turn = like(self.fields, frame[:, :3].T)
        return self._replace(points=points, directions=directions, fields=self.fields @ turn)

    @property
    def left(self) -> Bool[Tensor, " n"]:
        """The rays that have left the body, or are still on their way."""
        return self.fates == Fate.LEFT_LENS

    @property
    def flux(self) -> Float[Tensor, " n"]:
        """Flux (W)."""
        return 0.5 * self.carried * _squares(self.fields).sum(dim=(1, 2))

    @property
    def axial_flux(self) -> Float[Tensor, " n"]:
        """Flux (W) times the squared part of the unit field along z."""
        return 0.5 * self.carried * _squares(self.fields[:, :, 2]).sum(dim=1)


def _squares(values: Complex[Tensor, "*n"]) -> Float[Tensor, "*n"]:
    return values.real.square() + values.imag.square()
