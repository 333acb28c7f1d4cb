"""Parameters of a search: relative weights and offsets of the faces, by name, their tables, and their symmetry.

The tables are a differentiable torch operation. A lens may have the mirror symmetry that source, fixed surface,
receivers and targets share, and no larger one.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, cast

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.errors import remedy
from lensforge.kernels.parallel import in_parallel
from lensforge.scene.lens import Lens
from lensforge.scene.receiver import PosedReceiver
from lensforge.spec import AnyAccuracy, Spec
from lensforge.surfaces.bicubic_table import BasisTables, TableGrid, dyadic_grid, tabulate
from lensforge.surfaces.mirror_group import generators
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface, fibonacci_hemisphere, level_sigma
from lensforge.surfaces.surface import Surface


class _Tables(torch.autograd.Function):
    """The tables of the columns of weights, a thread for each; and the gradient by the weights."""

    @staticmethod
    def forward(ctx: Any, weights: Tensor, tables: BasisTables) -> Tensor:
        ctx.tables = tables
        ctx.shape = weights.shape
        columns = np.ascontiguousarray(weights.detach().numpy().T)
        sums = np.empty((len(columns), tables.side, tables.side))

        def work(face: int) -> None:
            sums[face] = tables.table(columns[face])

        in_parallel(work, len(columns))
        return torch.from_numpy(sums)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        by_tables = gradients[0].contiguous().numpy()
        by_weights = np.empty(ctx.shape)

        def work(face: int) -> None:
            by_weights[:, face] = ctx.tables.by_weights(by_tables[face], len(by_weights))

        in_parallel(work, len(by_tables))
        return torch.from_numpy(by_weights), None


def sums_of(weights: Float[Tensor, "k f"], tables: BasisTables) -> Float[Tensor, "f side side"]:
    """The sums of a basis by its first ``k`` functions, a table for each column of ``weights``; differentiable."""
    return _Tables.apply(weights, tables)  # type: ignore[no-untyped-call]  # as torch has it


_FIT_DIRECTIONS = 8  # for each function
_FIT_CHUNK = 4096  # directions at a time
_FIT_DAMPING = 1e-10


class Parametrisation(ABC):
    """Parameters of the faces ``names`` on one ``grid`` of tables: weights, a column for each face, and offsets.

    Parameters are relative to the start of the search: a unit step means the same for a lens of any size. The column of
    a face that is ``fixed`` has no effect.
    """

    is_steep: ClassVar[bool] = False  # True where a step of the usual length may lead to tables that no ray can follow
    grid: TableGrid
    names: tuple[str, ...]
    fixed: tuple[Surface | None, ...]

    @property
    @abstractmethod
    def levels(self) -> tuple[int, ...]:
        """Weights of each level, coarse first."""

    @property
    def size(self) -> int:
        """Weights of a face."""
        return sum(self.levels)

    def start(self, functions: int | None = None) -> tuple[Float[Tensor, "k f"], Float[Tensor, " f"]]:
        """Relative weights, by default of all functions, and offsets of the lens from which a search starts."""
        count = self.size if functions is None else functions
        faces = len(self.names)
        return torch.zeros(count, faces, dtype=torch.float64), torch.ones(faces, dtype=torch.float64)

    @cached_property
    def fixed_tables(self) -> list[Float[Tensor, "side side"] | None]:
        """Tables (mm) of the faces that are fixed."""
        return [None if fixed is None else torch.from_numpy(tabulate(self.grid, fixed)) for fixed in self.fixed]

    @property
    @abstractmethod
    def start_surfaces(self) -> dict[str, Surface]:
        """The faces from which a search starts."""

    @abstractmethod
    def refined(self) -> "Parametrisation":
        """Parametrisation whose tables have half the step, of the same splines."""

    @abstractmethod
    def tables(self, weights: Float[Tensor, "k f"], offsets: Float[Tensor, " f"]) -> Float[Tensor, "f side side"]:
        """Tables (mm) of the faces from the first ``k`` relative weights; differentiable."""

    @abstractmethod
    def parameters_of(self, lens: Lens) -> tuple[Float[Tensor, "m f"], Float[Tensor, " f"]]:
        """Relative weights and offsets that give the free faces of ``lens``."""

    @abstractmethod
    def surfaces(self, weights: Float[Tensor, "m f"], offsets: Float[Tensor, " f"]) -> dict[str, Surface]:
        """The faces of these parameters."""

    def lens(
        self, weights: Float[Tensor, "m f"], offsets: Float[Tensor, " f"], spec: Spec, seed: int, accuracy: AnyAccuracy
    ) -> Lens:
        """The frozen record of these parameters."""
        return Lens(self.surfaces(weights, offsets), spec, seed, accuracy)


@dataclass(frozen=True)
class SphereParameters(Parametrisation):
    """Faces that begin as hemispheres, and share one basis of SRBFs and one map to tables."""

    basis: SrbfBasis
    grid: TableGrid
    basis_tables: BasisTables
    scale_mm: Float[Tensor, " f"]
    fixed: tuple[Surface | None, ...]
    names: tuple[str, ...]

    @staticmethod
    def of(spec: Spec, nodes_per_sigma: float) -> "SphereParameters":
        """Parametrisation of the spec's lens, on a grid that resolves its narrowest feature."""
        lens = spec.lens
        basis = spec.lens.basis
        with remedy("raise lens.sigma_c, lower the last of lens.levels, or take a lower accuracy"):
            sigmas = [level_sigma(count, basis.sigma_c) for count in basis.levels]
            details = [surface.detail_rad for surface in lens.fixed.values() if surface is not None]
            grid, halvings = dyadic_grid([*sigmas, *details], nodes_per_sigma)
            tables = BasisTables.of(basis, grid, halvings[: len(sigmas)])
        scale_mm = torch.tensor([*lens.start_mm.values()], dtype=torch.float64)
        return SphereParameters(basis, grid, tables, scale_mm, tuple(lens.fixed.values()), lens.names)

    @property
    def levels(self) -> tuple[int, ...]:
        """Functions of each level."""
        return self.basis.levels

    @property
    def start_surfaces(self) -> dict[str, Surface]:
        """Hemispheres, and the fixed faces."""
        radii = zip(self.names, self.fixed, self.scale_mm.tolist(), strict=True)
        return {name: fixed or _hemisphere(radius_mm) for name, fixed, radius_mm in radii}

    def refined(self) -> "SphereParameters":
        """Parametrisation whose tables have half the step, of the same splines."""
        grid = TableGrid(2 * self.grid.nodes - 1)
        return replace(self, grid=grid, basis_tables=replace(self.basis_tables, side=grid.side))

    def tables(self, weights: Float[Tensor, "k f"], offsets: Float[Tensor, " f"]) -> Float[Tensor, "f side side"]:
        """Tables (mm) of the faces from the first ``k`` relative weights; differentiable."""
        free = ((sums_of(weights, self.basis_tables).permute(2, 1, 0) + offsets) * self.scale_mm).unbind(dim=-1)
        return torch.stack(
            [
                mirror_mean(free_table.T, self.basis.symmetry) if fixed is None else fixed
                for free_table, fixed in zip(free, self.fixed_tables, strict=True)
            ]
        )

    def parameters_of(self, lens: Lens) -> tuple[Float[Tensor, "m f"], Float[Tensor, " f"]]:
        """Relative weights and offsets that give the free faces of ``lens``.

        Exact where a surface has this basis; any other is fitted in least squares over the hemisphere.
        """
        weights, offsets = self.start()
        for face, (name, fixed) in enumerate(zip(self.names, self.fixed, strict=True)):
            if fixed is None:
                surface = lens.surfaces[name]
                has_same_basis = isinstance(surface, SrbfSurface) and surface.basis == self.basis
                fitted = cast("SrbfSurface", surface) if has_same_basis else fit_surface(self.basis, surface)
                scale = self.scale_mm[face]
                weights[:, face] = torch.from_numpy(fitted.weights_mm) / scale
                offsets[face] = fitted.offset_mm / scale
        return weights, offsets

    def surfaces(self, weights: Float[Tensor, "m f"], offsets: Float[Tensor, " f"]) -> dict[str, Surface]:
        """The sums of these parameters, and the fixed faces."""
        millimetres = (weights * self.scale_mm).numpy()
        radii = (offsets * self.scale_mm).tolist()
        return {
            name: SrbfSurface(self.basis, millimetres[:, face].copy(), radii[face]) if fixed is None else fixed
            for face, (name, fixed) in enumerate(zip(self.names, self.fixed, strict=True))
        }


_HEMISPHERE = SrbfBasis((4,), 1.75)


def _hemisphere(radius_mm: float) -> Surface:
    return SrbfSurface(_HEMISPHERE, np.zeros(_HEMISPHERE.size), radius_mm)


def fit_surface(basis: SrbfBasis, surface: Surface) -> SrbfSurface:
    """Fit ``surface`` by a sum over ``basis``: least squares of the radius over the hemisphere.

    Its offset is the mean radius; slight damping keeps the weights of nearly dependent functions small.
    """
    directions = fibonacci_hemisphere(_FIT_DIRECTIONS * basis.size)
    radius = surface.radius(directions)
    offset = float(radius.mean())
    normal = np.zeros((basis.size, basis.size))
    right = np.zeros(basis.size)
    for rows in np.array_split(np.arange(len(directions)), max(1, len(directions) // _FIT_CHUNK)):
        values = basis.evaluate(directions[rows])
        normal += values.T @ values
        right += values.T @ (radius[rows] - offset)
    normal[np.diag_indices(basis.size)] += _FIT_DAMPING * float(np.trace(normal)) / basis.size
    return SrbfSurface(basis, np.linalg.solve(normal, right), offset)


_SAME = 1e-9  # of a mirrored frame, and of a centre relative to its distance

_Turns = tuple[tuple[bool, tuple[int, ...]], ...]
ChartMirrors = tuple[tuple[tuple[int, int], tuple[int, int]], ...]  # signed permutations of the chart's coordinates


def chart_mirrors(receiver: PosedReceiver, name: str) -> ChartMirrors | None:
    """Action of a mirror group's generators on a receiver's chart; None if its mirror image is another receiver."""
    housing = receiver.housing
    if not receiver.lamps.has_mirrors(name) or (housing is not None and not housing.has_mirrors(name)):
        return None
    mirrors = []
    centre = np.array(receiver.pose.origin_mm)
    for mirror in generators(name):
        moved = np.linalg.norm(mirror @ centre - centre)
        action = receiver.pose.to_local_map(mirror)
        signs = np.round(action[:2, :2])
        swaps = signs[0, 0] == 0.0
        whole = np.block([[signs, np.zeros((2, 1))], [np.zeros((1, 2)), 1.0]])
        grid = receiver.grid
        square = grid.rows == grid.columns and grid.width == grid.height and receiver.has_quarter_turn
        kept = np.allclose(action, whole, rtol=0.0, atol=_SAME) and moved <= _SAME * np.linalg.norm(centre)
        if not kept or (swaps and not square):
            return None
        (a, b), (c, d) = signs.astype(int).tolist()
        mirrors.append(((a, b), (c, d)))
    return tuple(mirrors)


class _MirrorMean(torch.autograd.Function):
    """Mean over mirror images of a square of numbers, or a picture: one after another by each of some ``turns``.

    A turn: True where rows and columns change places, and the axes that are then reversed.
    """

    @staticmethod
    def forward(ctx: Any, values: Tensor, turns: _Turns) -> Tensor:
        ctx.turns = turns
        mean = values.detach().numpy()
        for swapped, axes in turns:
            mean = 0.5 * (mean + np.flip(mean.T if swapped else mean, axes))
        return torch.from_numpy(mean)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        by = gradients[0].numpy()
        for swapped, axes in reversed(ctx.turns):
            turned = np.flip(by, axes)
            by = 0.5 * (by + (turned.T if swapped else turned))
        return torch.from_numpy(by), None


def _mirror_mean(values: Float[Tensor, "h w"], turns: _Turns) -> Float[Tensor, "h w"]:
    if not turns:
        return values
    return _MirrorMean.apply(values, turns)  # type: ignore[no-untyped-call]  # as torch has it


def mirrored_light(image: Float[Tensor, "h w"], mirrors: ChartMirrors) -> Float[Tensor, "h w"]:
    """Mean over the mirror images of the light on a receiver: that of a scene with the symmetry, with more rays."""
    turns = []
    for (a, b), (c, d) in mirrors:
        turned = tuple(axis for axis, sign in ((1, a + b), (0, c + d)) if sign < 0)
        turns.append((not a, turned))
    return _mirror_mean(image, tuple(turns))


def mirror_mean(grid: Float[Tensor, "p p"], symmetry: str) -> Float[Tensor, "p p"]:
    """Mean over the mirror images of values on a square grid about the axis, first index x, second y."""
    turns: list[tuple[bool, tuple[int, ...]]] = []
    if symmetry in ("mirror_x", "rectangle", "square"):
        turns.append((False, (0,)))
    if symmetry in ("mirror_y", "rectangle", "square"):
        turns.append((False, (1,)))
    if symmetry in ("diagonal", "square"):
        turns.append((True, ()))
    return _mirror_mean(grid, tuple(turns))
