"""Parameters of faces of revolution, by their profiles, and of SRBFs beside them: TIR lenses and reflectors.

The reciprocal radius of a face is its profile plus the sum of SRBFs, all over an offset that scales the face about the
origin. The side of a cavity stays the cone that its draft asks for, a mouth or a flat exit a plane: only their offsets
move. The back of a reflector follows its cup: it has the cup's parameters, and an offset of its own beside.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.errors import InputError, remedy
from lensforge.scene.body import Body, Face, nearest
from lensforge.scene.lens import Lens
from lensforge.search.parameters import Parametrisation, mirror_mean, sums_of
from lensforge.search.start_faces import start_faces
from lensforge.spec import Spec
from lensforge.spec.lens_section import ProfiledShape
from lensforge.surfaces.bicubic_table import APRON, BasisTables, TableGrid, dyadic_grid
from lensforge.surfaces.grooved_face import Groove, GroovedFace, blended
from lensforge.surfaces.profile import AXIS, HORIZON, FormedFace, ProfileBasis, ProfileFace, around, shrunk
from lensforge.surfaces.reciprocal import ConeFace, PlaneFace, ReciprocalSurface, bent
from lensforge.surfaces.srbf import SrbfBasis, fibonacci_hemisphere, level_sigma
from lensforge.surfaces.surface import Surface

_DIRECTIONS = 4000  # at which the part of a face that bounds its medium is looked for
_BEYOND = 0.1  # cosine by which a profile bends beyond that part: creases move, and beyond it all bends fade
_LOWEST = -0.1  # cosine: exported faces reach a little below z = 0
_MERIDIAN = 96  # angles at which a face of no revolution is fitted, on each of its meridians
_NODES_PER_SIGMA = 6.0  # at least: with 2.5 the wall is 30 um off at its rim


@dataclass(frozen=True)
class FaceParameters:
    """One face by its ``start``: weights of the functions of its profile, relative to ``steps`` (1/mm).

    The steps of a cup differ: 1/rho at its rim is a tenth of its value at the foot, or less. ``scale``: of SRBFs.
    """

    start: ReciprocalSurface
    basis: ProfileBasis
    scale: float
    steps: Float[np.ndarray, " c"]
    srbf: SrbfBasis | None = None

    @cached_property
    def start_profile(self) -> ProfileFace:
        """The start by these functions."""
        return self.shaped(self.start)

    @property
    def first(self) -> Float[np.ndarray, " c"]:
        """Coefficients of the start's profile."""
        return np.array(self.start_profile.coefficients)

    def shaped(self, surface: Surface) -> ProfileFace:
        """``surface`` by these functions: itself where it has them, else in least squares; of no revolution by both."""
        basis = self.basis
        reach_mm = self.start.reach_mm
        has_other_functions = isinstance(surface, FormedFace) and surface.srbf != self.srbf
        if isinstance(surface, ProfileFace) and surface.basis == basis and not has_other_functions:
            return surface
        is_round = surface.symmetry == "square" and not isinstance(surface, FormedFace)
        if self.srbf is None or is_round or not isinstance(surface, ReciprocalSurface):
            return ProfileFace.fitted(surface, basis.low, basis.high, basis.count, reach_mm)
        directions = around(np.linspace(np.arccos(basis.high), np.arccos(basis.low), _MERIDIAN))
        return FormedFace.nearest(directions, surface.value(directions), basis, self.srbf, reach_mm)

    def weights_of(self, surface: ProfileFace) -> Float[np.ndarray, " m"]:
        """Weights (1/mm) of its SRBFs in ``surface``; 0 in one that has others."""
        if isinstance(surface, FormedFace) and surface.srbf == self.srbf:
            return surface.weights_per_mm
        return np.zeros(0 if self.srbf is None else self.srbf.size)


@dataclass(frozen=True)
class GroovedParameters:
    """A face of two zones by its ``start``: ``zones`` are lens and ring, which share its coefficients by halves."""

    start: GroovedFace
    zones: tuple[FaceParameters, FaceParameters]

    @staticmethod
    def of(face: GroovedFace, within: ProfileBasis) -> "GroovedParameters":
        """Parameters of ``face`` for as many functions as ``within`` has, between its cosines."""
        groove = Groove.of(face.lens, face.ring)
        assert groove is not None
        first = within.count // 2
        lens = ProfileBasis(max(within.low, groove.cosine - _BEYOND), within.high, first)
        ring = ProfileBasis(within.low, min(within.high, groove.cosine + _BEYOND), within.count - first)
        scale = groove.value
        lens_zone, ring_zone = (
            FaceParameters(zone, basis, scale, np.full(basis.count, scale))
            for zone, basis in ((face.lens, lens), (face.ring, ring))
        )
        return GroovedParameters(face, (lens_zone, ring_zone))

    @property
    def parts(self) -> tuple[slice, slice]:
        """Coefficients of lens and ring, of all in a row."""
        first = self.zones[0].basis.count
        return slice(0, first), slice(first, None)

    def weights_of(self, face: GroovedFace) -> Float[np.ndarray, " c"]:
        """Weights that give ``face``, of other functions in least squares."""
        shaped = [zone.shaped(there) for zone, there in zip(self.zones, (face.lens, face.ring), strict=True)]
        moved = [
            (np.array(there.coefficients) - zone.first) / zone.steps
            for zone, there in zip(self.zones, shaped, strict=True)
        ]
        return np.concatenate(moved)

    def face(self, weights: Float[np.ndarray, " c"], factor: float) -> GroovedFace:
        """The face of these weights, the reciprocal radii of its zones times ``factor``."""
        lens, ring = (
            ProfileFace(
                zone.start.reach_mm,
                zone.basis.low,
                zone.basis.high,
                tuple((factor * (zone.first + zone.steps * weights[part])).tolist()),
            )
            for zone, part in zip(self.zones, self.parts, strict=True)
        )
        return replace(self.start, lens=lens, ring=ring)


_Shape = FaceParameters | GroovedParameters | ReciprocalSurface


@dataclass(frozen=True, eq=False)
class ProfileParameters(Parametrisation):
    """Free faces of revolution, with SRBFs of ``srbf`` beside them where there are some.

    ``columns``: number of the face whose parameters each face has: its own, or one that it follows.
    """

    grid: TableGrid
    names: tuple[str, ...]
    fixed: tuple[Surface | None, ...]
    parameters: tuple[_Shape | None, ...]
    columns: tuple[int, ...]
    profile: int
    srbf: SrbfBasis | None = None
    srbf_tables: BasisTables | None = None

    @staticmethod
    def of(spec: Spec, nodes_per_sigma: float) -> "ProfileParameters":
        """Parameters of the faces of a lens with creases, from the start that its spec asks for."""
        lens = spec.lens
        assert isinstance(lens, ProfiledShape)
        start = start_faces(spec)
        body = Body.of(start, lens.body_roles)
        leaders = {role.name: role.follows for role in lens.body_roles}
        fixed = {name: None if name in lens.free else surface for name, surface in start.items()}
        parameters: list[_Shape | None] = []
        srbf = lens.basis if lens.levels else None
        for face in body.faces:
            if fixed[face.name] is not None:
                parameters.append(None)
            elif isinstance(face.surface, ConeFace | PlaneFace):
                parameters.append(face.surface)
            elif (leader := leaders[face.name]) is not None:
                parameters.append(_following(face, parameters[lens.body_names.index(leader)]))
            else:
                parameters.append(_parameters(body, face.name, lens.profile, srbf))
        with remedy(f"take a lower accuracy, or {lens.coarser}"):
            details = [surface.detail_rad for surface in start.values()]
            sigmas = [] if srbf is None else [level_sigma(count, srbf.sigma_c) for count in srbf.levels]
            grid, halvings = dyadic_grid([*sigmas, *details], max(nodes_per_sigma, _NODES_PER_SIGMA))
            sums = None if srbf is None else BasisTables.of(srbf, grid, halvings[: len(sigmas)])
        names = lens.body_names
        given = tuple(fixed.values())
        columns = tuple(names.index(leaders[name] or name) for name in names)
        return ProfileParameters(grid, names, given, tuple(parameters), columns, lens.profile, srbf, sums)

    @property
    def levels(self) -> tuple[int, ...]:
        """Coefficients of a profile, and the functions of each level."""
        return (self.profile, *(() if self.srbf is None else self.srbf.levels))

    @property
    def start_surfaces(self) -> dict[str, Surface]:
        """The faces of the start."""
        return self.surfaces(*self.start())

    def refined(self) -> "ProfileParameters":
        """Parametrisation whose tables have half the step."""
        grid = TableGrid(2 * self.grid.nodes - 1)
        sums = self.srbf_tables
        return replace(self, grid=grid, srbf_tables=None if sums is None else replace(sums, side=grid.side))

    def tables(self, weights: Float[Tensor, "k f"], offsets: Float[Tensor, " f"]) -> Float[Tensor, "f side side"]:
        """Tables (mm) of the faces from the first ``k`` relative weights; differentiable."""
        weights, offsets = self._by_face(weights, offsets)
        tables = []
        sums = self._sums(weights[self.profile :])
        for face, shape in enumerate(self.parameters):
            table = self.fixed_tables[face]
            if table is not None:
                tables.append(table)
                continue
            assert shape is not None
            values = self._reciprocal(shape, face, weights, sums, offsets[face]) / offsets[face]
            reach = shape.reach_mm if isinstance(shape, ReciprocalSurface) else shape.start.reach_mm
            samples = (1.0 / bent(values, reach)).reshape(len(self._filter[0]), -1)
            tables.append(self._filter @ samples @ self._filter.T)
        return torch.stack(tables)

    def _by_face(
        self, weights: Float[Tensor, "k f"], offsets: Float[Tensor, " f"]
    ) -> tuple[Float[Tensor, "k f"], Float[Tensor, " f"]]:
        columns = list(self.columns)
        unchanged = list(range(len(columns)))
        if columns == unchanged:
            return weights, offsets
        return weights[:, columns], torch.where(
            torch.tensor(columns) == torch.tensor(unchanged), 1.0, offsets
        ) * offsets[columns]

    def _reciprocal(self, shape: _Shape, face: int, weights: Tensor, sums: Tensor | None, offset: Tensor) -> Tensor:
        """``1/rho`` (1/mm) at the nodes, before division by the ``offset``.

        The band of a groove is multiplied by the offset, so that the division restores that of the start.
        """
        if isinstance(shape, ReciprocalSurface):
            return torch.from_numpy(shape.value(self._nodes))
        if isinstance(shape, GroovedParameters):
            lens, ring = (
                functions @ _column(zone, weights[part, face])
                for functions, zone, part in zip(self._profiles[face], shape.zones, shape.parts, strict=True)
            )
            return blended(lens, ring, shape.start.band_per_mm * offset)
        (functions,) = self._profiles[face]
        values = functions @ _column(shape, weights[: self.profile, face]) + self._start_sums[face]
        return values if sums is None else values + shape.scale * sums[face].reshape(-1)

    def _sums(self, weights: Float[Tensor, "k f"]) -> Float[Tensor, "f n n"] | None:
        """Sums of the SRBFs of each face at the nodes; None without any."""
        if self.srbf is None or self.srbf_tables is None or not len(weights):
            return None
        tables = sums_of(weights, self.srbf_tables).unbind()
        return torch.stack(
            [self._sampled @ mirror_mean(table, self.srbf.symmetry) @ self._sampled.T for table in tables]
        )

    @cached_property
    def _nodes(self) -> Float[np.ndarray, "n 3"]:
        return self.grid.sample_directions()

    @cached_property
    def _profiles(self) -> list[tuple[Tensor, ...]]:
        """Functions of each face at the nodes: of one profile, of two zones, or none."""
        cosines = self._nodes[:, 2]
        return [
            tuple(torch.from_numpy(profile.basis.matrix(cosines)) for profile in _profiles_of(shape))
            for shape in self.parameters
        ]

    @cached_property
    def _start_sums(self) -> list[Tensor | float]:
        """Sums of the SRBFs of the start of each face, at the nodes; 0 for a face of revolution."""
        sums: list[Tensor | float] = [0.0] * len(self.parameters)
        for face, shape in enumerate(self.parameters):
            if isinstance(shape, FaceParameters) and isinstance(shape.start_profile, FormedFace):
                sums[face] = torch.from_numpy(
                    shape.start_profile.srbf.evaluate(self._nodes) @ shape.start_profile.weights_per_mm
                )
        return sums

    @cached_property
    def _sampled(self) -> Float[Tensor, "n side"]:
        """Matrix from coefficients to the nodes and, mirrored at the points of the first and last, their apron."""
        count = self.grid.nodes
        side = self.grid.side
        at_nodes = (np.eye(count, side) + 4.0 * np.eye(count, side, 1) + np.eye(count, side, 2)) / 6.0
        return torch.from_numpy(np.pad(at_nodes, ((APRON, APRON), (0, 0)), mode="reflect", reflect_type="odd"))

    @cached_property
    def _filter(self) -> Float[Tensor, "side n"]:
        return torch.from_numpy(self.grid.filter_matrix())

    def parameters_of(self, lens: Lens) -> tuple[Float[Tensor, "m f"], Float[Tensor, " f"]]:
        """Relative weights and offsets that give the free faces of ``lens``; its profiles in least squares."""
        weights, offsets = self.start()
        for face, (name, shape) in enumerate(zip(self.names, self.parameters, strict=True)):
            surface = lens.surfaces[name]
            if isinstance(shape, ConeFace | PlaneFace):
                towards = HORIZON if isinstance(shape, ConeFace) else AXIS
                offsets[face] = surface.radius(towards)[0] / shape.radius(towards)[0]
            elif isinstance(shape, GroovedParameters):
                if not isinstance(surface, GroovedFace):
                    raise InputError(
                        f"lens.start: its {name} has no groove; leave lens.{name}.groove_radius_mm out, or start from "
                        "a lens that has one"
                    )
                weights[: self.profile, face] = torch.from_numpy(shape.weights_of(surface))
            elif isinstance(shape, FaceParameters) and self.columns[face] == face:
                shaped = shape.shaped(surface)
                start_profile = shape.start_profile
                moved = (np.array(shaped.coefficients) - shape.first) / shape.steps
                weights[: self.profile, face] = torch.from_numpy(moved)
                functions = (shape.weights_of(shaped) - shape.weights_of(start_profile)) / shape.scale
                weights[self.profile :, face] = torch.from_numpy(functions)
        return weights, offsets

    def surfaces(self, weights: Float[Tensor, "m f"], offsets: Float[Tensor, " f"]) -> dict[str, Surface]:
        """The faces of these parameters."""
        surfaces: dict[str, Surface] = {}
        weights, offsets = self._by_face(weights, offsets)
        for face, (name, fixed, shape) in enumerate(zip(self.names, self.fixed, self.parameters, strict=True)):
            factor = 1.0 / float(offsets[face])
            if fixed is not None:
                surfaces[name] = fixed
            elif isinstance(shape, ConeFace | PlaneFace):
                surfaces[name] = shrunk(shape, factor)
            elif isinstance(shape, GroovedParameters):
                surfaces[name] = shape.face(weights[:, face].numpy(), factor)
            elif isinstance(shape, FaceParameters):
                moved = shape.first + shape.steps * weights[: self.profile, face].numpy()
                profile = shape.start.reach_mm, shape.basis.low, shape.basis.high, tuple((factor * moved).tolist())
                functions = factor * (
                    shape.weights_of(shape.start_profile) + shape.scale * weights[self.profile :, face].numpy()
                )
                surfaces[name] = ProfileFace(*profile)
                if self.srbf is not None and functions.any():
                    surfaces[name] = FormedFace(*profile, self.srbf, functions)
        return surfaces


def _profiles_of(shape: _Shape | None) -> tuple[FaceParameters, ...]:
    match shape:
        case FaceParameters():
            return (shape,)
        case GroovedParameters():
            return shape.zones
    return ()


def _column(profile: FaceParameters, weights: Tensor) -> Tensor:
    """Coefficients of a profile."""
    return torch.from_numpy(profile.first) + torch.from_numpy(profile.steps) * weights


def _parameters(body: Body, name: str, count: int, srbf: SrbfBasis | None) -> FaceParameters | GroovedParameters:
    """Parameters of a face over the part of it that bounds its medium, and a little more."""
    face = body.face(name)
    assert isinstance(face.surface, ReciprocalSurface)
    faces = body.bounding(face.before)
    directions = fibonacci_hemisphere(_DIRECTIONS)
    bounding = directions[nearest(faces, directions) == faces.index(face)]
    low = max(_LOWEST, bounding[:, 2].min() - _BEYOND)
    high = min(1.0, bounding[:, 2].max() + _BEYOND)
    reciprocals = np.abs(face.surface.value(bounding))
    basis = ProfileBasis(low, high, count)
    if isinstance(face.surface, GroovedFace):
        return GroovedParameters.of(face.surface, basis)
    if not any(face.is_open for face in faces):
        scale = float(reciprocals.mean())
        return FaceParameters(face.surface, basis, scale, np.full(count, scale), srbf)
    scale = float(reciprocals.min())
    parameters = FaceParameters(face.surface, basis, scale, np.full(count, scale), srbf)
    return replace(parameters, steps=np.maximum(np.abs(parameters.first), scale))


def _following(face: Face, leader: _Shape | None) -> FaceParameters:
    """Parameters of a face that follows another one: functions and scale are those of that one."""
    assert isinstance(face.surface, ReciprocalSurface) and isinstance(leader, FaceParameters)
    return replace(leader, start=face.surface)
