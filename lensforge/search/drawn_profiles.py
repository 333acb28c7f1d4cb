"""Parameters of profiles that are drawn along y: the coefficients of each, relative to the start, and its offset."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.errors import remedy
from lensforge.scene.lens import Lens
from lensforge.search.parameters import Parametrisation
from lensforge.search.start_faces import start_faces
from lensforge.spec import Spec
from lensforge.surfaces.bicubic_table import TableGrid, grid_for
from lensforge.surfaces.drawn_profile import DrawnFace, DrawnPart, beside_section, in_half_turns
from lensforge.surfaces.mirror_group import contains
from lensforge.surfaces.reciprocal import bent
from lensforge.surfaces.surface import Surface

_NODES_BESIDE_CREASES = 6.0  # for each sigma: with 2 a wall is 20 um off near its rim


@dataclass(frozen=True, eq=False)
class DrawnParameters(Parametrisation):
    """Profiles by their coefficients, of one ``start`` each; ``symmetric``: about the plane x = 0."""

    is_steep: ClassVar[bool] = True
    grid: TableGrid
    names: tuple[str, ...]
    start_faces: tuple[DrawnFace, ...]
    symmetric: bool

    @staticmethod
    def of(spec: Spec, nodes_per_sigma: float) -> "DrawnParameters":
        """Parameters of the profiles of ``spec``, on a grid that resolves them."""
        faces = start_faces(spec)
        profiles = [face for face in faces.values() if isinstance(face, DrawnFace)]
        if spec.lens.has_creases:
            nodes_per_sigma = max(nodes_per_sigma, _NODES_BESIDE_CREASES)
        with remedy(f"take a lower accuracy, or {spec.lens.coarser}"):
            grid = grid_for(min(face.detail_rad for face in profiles), nodes_per_sigma)
        symmetry = spec.lens.symmetry
        symmetric = symmetry != "auto" and contains(symmetry, "mirror_x")
        if symmetric:
            profiles = [face.mirrored for face in profiles]
        return DrawnParameters(grid, tuple(faces), tuple(profiles), symmetric)

    @property
    def fixed(self) -> tuple[Surface | None, ...]:  # type: ignore[override]  # all are free
        """None for each face."""
        return (None,) * len(self.names)

    @property
    def levels(self) -> tuple[int, ...]:
        """Coefficients of a profile."""
        return (len(self.start_faces[0].coefficients),)

    @property
    def start_surfaces(self) -> dict[str, Surface]:
        """The faces of the start."""
        return self.surfaces(*self.start())

    def refined(self) -> "DrawnParameters":
        """Parametrisation whose tables have half the step."""
        return replace(self, grid=TableGrid(2 * self.grid.nodes - 1))

    def tables(self, weights: Float[Tensor, "k f"], offsets: Float[Tensor, " f"]) -> Float[Tensor, "f side side"]:
        """Tables (mm) of the faces; differentiable."""
        tables = []
        for face, start in enumerate(self.start_faces):
            values = self._functions @ self._coefficients(weights, face) / offsets[face]
            samples = (1.0 / bent(values, start.reach_mm)).reshape(len(self._filter[0]), -1)
            tables.append(self._filter @ samples @ self._filter.T)
        return torch.stack(tables)

    def _coefficients(self, weights: Float[Tensor, "k f"], face: int) -> Float[Tensor, " k"]:
        first = torch.tensor(self.start_faces[face].coefficients, dtype=torch.float64)
        moved = weights[:, face]
        moved = 0.5 * (moved + moved.flip(0)) if self.symmetric else moved
        return first + first.abs().mean() * moved

    @cached_property
    def _functions(self) -> Float[Tensor, "n k"]:
        directions = self.grid.sample_directions()
        is_part = isinstance(self.start_faces[0], DrawnPart)
        shadow, angle = in_half_turns(beside_section(directions) if is_part else directions)
        return torch.from_numpy(shadow[:, None] * self.start_faces[0].basis.matrix(angle))

    @cached_property
    def _filter(self) -> Float[Tensor, "side n"]:
        return torch.from_numpy(self.grid.filter_matrix())

    def parameters_of(self, lens: Lens) -> tuple[Float[Tensor, "m f"], Float[Tensor, " f"]]:
        """Relative coefficients and offsets that give the faces of ``lens``; of other profiles the nearest ones."""
        weights, offsets = self.start()
        for face, (name, start) in enumerate(zip(self.names, self.start_faces, strict=True)):
            surface = lens.surfaces[name]
            assert isinstance(surface, DrawnFace)
            first = np.array(start.coefficients)
            moved = np.array(surface.with_coefficients(len(first)).coefficients) - first
            weights[:, face] = torch.from_numpy(moved / np.abs(first).mean())
        return weights, offsets

    def surfaces(self, weights: Float[Tensor, "m f"], offsets: Float[Tensor, " f"]) -> dict[str, Surface]:
        """The faces of these parameters."""
        surfaces: dict[str, Surface] = {}
        for face, (name, start) in enumerate(zip(self.names, self.start_faces, strict=True)):
            coefficients = (self._coefficients(weights, face) / offsets[face]).tolist()
            surfaces[name] = replace(start, coefficients=tuple(coefficients))
        return surfaces
