"""Lenses of several kinds in one search: their parameters side by side, and the light of all.

Columns of weights, and tables, are those of the faces of one kind after those of another. Each kind is traced with its
share of the rays and lights the receivers from its own places; what counts is the sum.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.scene.lens import Lens
from lensforge.search.collected_light import Collected
from lensforge.search.light_path import LightPath
from lensforge.search.parameters import Parametrisation
from lensforge.sources.ray_bundle import RayBundle
from lensforge.spec import AnyAccuracy, Spec
from lensforge.spec.lamps_section import Lamps
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.surface import Surface

_STRIPS = 256  # of a sample, dealt to the kinds: each strip of a Sobol sequence fills the source by itself
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def spec_of_each_kind(spec: Spec) -> dict[str, Spec]:
    """The spec with the mirror symmetry of the lens of each kind, by its name; ``spec`` has that of the sum."""
    lens = spec.lens
    return {
        kind.name: spec.changed(lens=lens.changed(symmetry=kind.symmetry(str(lens.symmetry))))
        for kind in spec.all_lamps.kinds
    }


@dataclass(frozen=True)
class KindsParameters(Parametrisation):
    """The parametrisations ``members`` of the lenses of ``kinds``, on one grid."""

    kinds: tuple[str, ...]
    members: tuple[Parametrisation, ...]
    grid: TableGrid
    names: tuple[str, ...]
    fixed: tuple[Surface | None, ...]

    @staticmethod
    def of(members: dict[str, Parametrisation]) -> "KindsParameters":
        """The parametrisation of all kinds; ``members``: by their names."""
        names = tuple(f"{kind}.{name}" for kind, member in members.items() for name in member.names)
        fixed = tuple(parametrisationsace for member in members.values() for parametrisationsace in member.fixed)
        parametrisations = tuple(members.values())
        return KindsParameters(tuple(members), parametrisations, parametrisations[0].grid, names, fixed)

    @property
    def levels(self) -> tuple[int, ...]:
        """Weights of each level, coarse first."""
        return self.members[0].levels

    @property
    def start_surfaces(self) -> dict[str, Surface]:
        """The faces of all kinds from which a search starts."""
        return {
            f"{kind}.{name}": face
            for kind, member in zip(self.kinds, self.members, strict=True)
            for name, face in member.start_surfaces.items()
        }

    def refined(self) -> "KindsParameters":
        """Parametrisation whose tables have half the step, of the same splines."""
        finer = tuple(member.refined() for member in self.members)
        return replace(self, members=finer, grid=finer[0].grid)

    def _of_each(
        self, weights: Float[Tensor, "k f"], offsets: Float[Tensor, " f"]
    ) -> list[tuple[Parametrisation, Float[Tensor, "k g"], Float[Tensor, " g"]]]:
        count = len(self.members)
        return list(zip(self.members, weights.chunk(count, dim=1), offsets.chunk(count), strict=True))

    def tables(self, weights: Float[Tensor, "k f"], offsets: Float[Tensor, " f"]) -> Float[Tensor, "f side side"]:
        """Tables (mm) of the faces of all kinds from the first ``k`` relative weights; differentiable."""
        return torch.cat([member.tables(*columns) for member, *columns in self._of_each(weights, offsets)])

    def parameters_of(self, lens: Lens) -> tuple[Float[Tensor, "m f"], Float[Tensor, " f"]]:
        """Relative weights and offsets that give the free faces of ``lens``; where it is one lens, for all kinds."""
        parameters = [
            member.parameters_of(lens.of_kind(kind) if lens.others else lens)
            for kind, member in zip(self.kinds, self.members, strict=True)
        ]
        weights, offsets = zip(*parameters, strict=True)
        return torch.cat(weights, dim=1), torch.cat(offsets)

    def surfaces(self, weights: Float[Tensor, "m f"], offsets: Float[Tensor, " f"]) -> dict[str, Surface]:
        """The faces of these parameters, of all kinds."""
        return {
            f"{kind}.{name}": face
            for kind, faces in self._faces(weights, offsets).items()
            for name, face in faces.items()
        }

    def _faces(self, weights: Float[Tensor, "m f"], offsets: Float[Tensor, " f"]) -> dict[str, dict[str, Surface]]:
        members = zip(self.kinds, self._of_each(weights, offsets), strict=True)
        return {kind: member.surfaces(*columns) for kind, (member, *columns) in members}

    def lens(
        self, weights: Float[Tensor, "m f"], offsets: Float[Tensor, " f"], spec: Spec, seed: int, accuracy: AnyAccuracy
    ) -> Lens:
        """The frozen record of these parameters: the lens of the first kind, with the others behind it."""
        faces = self._faces(weights, offsets)
        return Lens(faces.pop(self.kinds[0]), spec, seed, accuracy, others=faces)


@dataclass(frozen=True)
class LightOfKinds:
    """Light paths of lenses of several kinds; each takes its share of the rays, and lights from its own lamps."""

    paths: tuple[LightPath, ...]
    lamps: Lamps

    @staticmethod
    def of(path: LightPath, lamps: Lamps) -> "LightOfKinds":
        """The same ``path`` for the lens of each kind, to the receivers as its lamps see them."""
        receivers = [
            tuple(replace(receiver, lamps=receiver.lamps.of_kind(kind)) for receiver in path.receivers)
            for kind in lamps.kinds
        ]
        return LightOfKinds(tuple(replace(path, receivers=receiver) for receiver in receivers), lamps)

    def collect(self, tables: Float[Tensor, "f side side"], rays: RayBundle) -> tuple[Collected, ...]:
        """Trace ``rays`` through the tables of all kinds and collect the mean light of a lamp; differentiable."""
        every = zip(self.paths, tables.chunk(len(self.paths)), self._dealt(rays), strict=True)
        collected = [path.collect(member_tables, some) for path, member_tables, some in every if len(some)]
        return tuple(_sum(same) for same in zip(*collected, strict=True))

    def over_outlines(
        self, images: Sequence[Tensor], tables: Float[Tensor, "f side side"], rays: RayBundle
    ) -> list[Tensor]:
        """Pictures as they are: no eye sees lenses of several kinds."""
        return list(images)

    def _dealt(self, rays: RayBundle) -> list[RayBundle]:
        """The rays of each kind: strips all over the sample; their flux is that of its share of the lamps."""
        strips = np.arange(len(rays)) * _STRIPS // len(rays)
        shares = np.cumsum(self.lamps.shares_of_rays)
        number = np.searchsorted(shares / shares[-1], (strips + 0.5) * _GOLDEN % 1.0, side="right")
        emitted_w = float(rays.flux.sum())
        dealt = []
        for k, kind in enumerate(self.lamps.kinds):
            some = rays.take(number == k)
            own_w = emitted_w * len(kind.numbers) / len(self.lamps)
            dealt.append(replace(some, flux=some.flux * (own_w / some.flux.sum())) if len(some) else some)
        return dealt


def _sum(parts: Sequence[Collected]) -> Collected:
    fields = (name for name, value in vars(parts[0]).items() if value is not None)
    return Collected(**{name: torch.stack([getattr(part, name) for part in parts]).sum(dim=0) for name in fields})
