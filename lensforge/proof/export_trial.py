"""Tolerances and rings of an export: chosen so that its files use half of verification's limits.

Before the part is made, the light of its fitted faces is traced as that of the design is, in the place of the solid,
and its mesh is cast as verification casts it. Both are judged by the criteria of verification.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from lensforge import seeds
from lensforge.cad.boundary import Pair, TrimmedFace
from lensforge.cad.cutter_room import base_with_room
from lensforge.cad.face_tolerance import MAX_NODES, FaceTolerance
from lensforge.cad.facets import CHORD_MM
from lensforge.cad.flange import ring_of
from lensforge.cad.form_error import fit_lens
from lensforge.cad.mesh import MIN_RINGS, MOST_RINGS, BodyMesh, build_mesh, rings_for
from lensforge.cad.mesh_files import stl_bytes
from lensforge.cad.patch import Patch
from lensforge.cad.plan import Plan, make_plan
from lensforge.errors import InputError
from lensforge.kernels.parallel import thread_count
from lensforge.light.lens_light import judging_source
from lensforge.light.simulation import TracedLens
from lensforge.proof.acceptance import (
    DEVIATION_RAD,
    OF_SPREAD,
    brep_criteria,
    mesh_landing_criteria,
)
from lensforge.proof.cast_results import Agreement, BrepCast
from lensforge.proof.casts import expected_of, of_one_lamp, traced_exactly
from lensforge.proof.facet_casting import Grid
from lensforge.proof.part_comparison import Expected, Landed, compare
from lensforge.proof.part_mesh import read_part_mesh
from lensforge.proof.proof_inputs import optical_at_work
from lensforge.proof.sequential_cast import send_through
from lensforge.results import Fact
from lensforge.scene.lens import Lens
from lensforge.sources.measured_rays import rays_of_file
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid, evaluate_table
from lensforge.surfaces.surface import to_chart, to_sphere

MARGIN = 2.0  # of the limits, which other rays and the faces as read back use otherwise
_RAYS = 4096
_ROUNDS = 8
_AIM = 0.8  # of what is allowed, by the power of the step below
_SMALLEST_STEP = 1.15
_LARGEST_STEP = 2.5
_RINGS_POWER = 2.0  # by which the displacement through a mesh falls with its rings, 2 to 4
_LEAST_GAIN = 0.9  # of what was used before: what finer files do not lessen is not theirs
_OF_MOST = 0.95  # of the triangles of the finest mesh on trial, as their number is known to a few per cent
_MOST_TRIANGLES = 600_000  # of a mesh on trial: one of a million takes minutes and 2 GB to read and cast


@dataclass(frozen=True)
class Fineness:
    """Tolerance of the optical faces of a STEP file, and least number of rings of the mesh beside it."""

    tolerance: FaceTolerance
    rings: int = MIN_RINGS


def fineness(lens: Lens, tolerance: FaceTolerance, nodes: int | None = None, rings: int | None = None) -> Fineness:
    """Fineness of an export of ``lens``: at least that of ``tolerance``, and finer if the light needs it.

    ``nodes``, ``rings``: fixed numbers, if given.
    """
    if lens.spec.lens.drawn_mm is not None:  # its splines are of one variable, and cost nothing
        return Fineness(tolerance)
    try:
        trials = [_Trial(led_lens) for led_lens in lens.by_state.values()]
    except InputError as error:  # a file of the source that is gone, or no light that could be traced
        warnings.warn(f"export: {error}; normals and mesh are by their tolerances alone", stacklevel=2)
        return Fineness(tolerance)
    if nodes is None:
        tolerance = _settled_tolerance(lens, tolerance, trials)
    if rings is not None:
        return Fineness(tolerance)
    pair = fit_lens(lens, *([] if nodes is None else [nodes] * len(lens.surfaces)), tolerance=tolerance)
    return Fineness(tolerance, _settled_rings(lens, pair, trials))


def _settled_tolerance(lens: Lens, tolerance: FaceTolerance, trials: "list[_Trial]") -> FaceTolerance:
    """The tolerance with normals as close as the light needs, where the splines follow it and gain by it."""
    pair = fit_lens(lens, tolerance=tolerance)
    used = max(trial.used_by_faces(pair) for trial in trials)
    for _ in range(_ROUNDS):
        if used * MARGIN <= 1.0:
            break
        finer = tolerance.changed(normal_mrad=tolerance.normal_mrad / _step(used * MARGIN, 1.0))
        pair, nodes = fit_lens(lens, tolerance=finer), _nodes(pair)
        if _nodes(pair) != nodes:
            before = used
            used = max(trial.used_by_faces(pair) for trial in trials)
            if used > _LEAST_GAIN * before or max(_nodes(pair)) == MAX_NODES:
                break
        tolerance = finer  # where that took no more nodes, the fit was better than it had to be
    return tolerance


def _nodes(pair: Pair[Patch]) -> list[int]:
    return [face.shape.nodes for boundary in pair for face in boundary.of_material]


def _settled_rings(lens: Lens, pair: Pair[Patch], trials: "list[_Trial]") -> int:
    """Rings from which the mesh lands light within the margin, or the most that are tried, with a warning."""
    plan = make_plan(*pair, base_with_room(lens), ring_of(lens, pair[1]))
    rings = rings_for(plan, CHORD_MM)
    mesh = build_mesh(plan, rings, CHORD_MM)
    if len(mesh.triangles) > _MOST_TRIANGLES:  # for its detail finer than any mesh on trial
        return rings
    used = max(trial.used_by_mesh(mesh) for trial in trials)
    for _ in range(_ROUNDS):
        if used * MARGIN <= 1.0:
            break
        wanted = int(np.ceil(rings * _step(used * MARGIN, _RINGS_POWER)))
        more = min(MOST_RINGS, wanted, _most_rings(rings, mesh))
        finer = _mesh_on_trial(plan, more) if more > rings else None
        if finer is None:
            break
        before = used
        used = max(trial.used_by_mesh(finer) for trial in trials)
        if used > _LEAST_GAIN * before:
            break
        rings = more
        mesh = finer
    if used > 1.0:
        warnings.warn(
            f"export: with {rings} rings the facets of lens.stl use {used:.3g} times what verification allows, and "
            "more are too many, or gain too little; lens.step decides, --rings makes them finer",
            stacklevel=3,
        )
    return rings


def _most_rings(rings: int, mesh: BodyMesh) -> int:
    """The most rings of a mesh on trial, from the mesh of ``rings``: triangles grow at most as the square."""
    return int(rings * (_OF_MOST * _MOST_TRIANGLES / len(mesh.triangles)) ** 0.5)


def _mesh_on_trial(plan: Plan[Patch], rings: int) -> BodyMesh | None:
    """The mesh of ``rings`` rings; None if it has too many triangles."""
    try:
        mesh = build_mesh(plan, rings, CHORD_MM)
    except InputError:
        return None
    return mesh if len(mesh.triangles) <= _MOST_TRIANGLES else None


def _step(excess: float, power: float) -> float:
    """Factor of refinement for files that use ``excess`` of their share of a limit, which falls with a power of it."""
    return min(max((excess / _AIM) ** (1.0 / power), _SMALLEST_STEP), _LARGEST_STEP)


class _Trial:
    """Rays of one LED through a lens as designed, and the use that its files make of their limits."""

    def __init__(self, lens: Lens) -> None:
        source = rays_of_file(judging_source(lens.spec))
        self._lens = of_one_lamp(lens)
        self._optical = optical_at_work(lens)
        self._rays: RayBundle = source.sample(min(_RAYS, source.ray_count or _RAYS), seeds.of_verification(lens.seed))
        self._traced = traced_exactly(self._lens)
        self._expected = self._landings(self._traced)

    def _landings(self, traced: TracedLens) -> list[Expected]:
        polished = bool(self._lens.media.scattering)
        return expected_of(self._lens, None, self._rays, self._optical, polished=polished, traced=traced)

    def used_by_faces(self, pair: Pair[Patch]) -> float:
        """Largest share of a limit that the fitted faces use as those of a STEP file."""
        fitted = {face.name: face for boundary in pair for face in boundary.faces if not face.is_open}
        tables = self._traced.tables.copy()
        grid = self._traced.scene.grid
        for table, name in zip(tables, self._traced.scene.names, strict=True):
            if name in fitted:
                table += _form_error(grid, table, fitted[name])
        return self._most_used(self._landings(replace(self._traced, tables=tables)), _as_step)

    def used_by_mesh(self, mesh: BodyMesh) -> float:
        """Largest share of a limit that ``mesh`` uses as that of an STL file."""
        part = read_part_mesh(stl_bytes(mesh), self._optical)
        media = self._lens.media
        passage = send_through(part, Grid(part.mesh), self._rays, media.polished, thread_count())
        landed = [passage.landed(expected.screen) for expected in self._expected]
        limit_rad = DEVIATION_RAD + OF_SPREAD * media.spread_rad
        return self._most_used(
            landed, lambda agreement, reach_mm: mesh_landing_criteria(agreement, limit_rad * reach_mm)
        )

    def _most_used(self, landed: Sequence[Landed], criteria: Callable[[Agreement, float], Sequence[Fact]]) -> float:
        """Largest share of a limit on any receiver that has light."""
        pairs = [
            (landing, by_design) for landing, by_design in zip(landed, self._expected, strict=True) if _lit(by_design)
        ]
        judged = (
            criteria(compare(self._rays, landing, by_design), by_design.screen.reach_mm(by_design.irradiance))
            for landing, by_design in pairs
        )
        return max((float(fact.value or 0.0) / fact.bound for facts in judged for fact in facts), default=0.0)


def _lit(expected: Expected) -> bool:
    return bool(expected.irradiance.any())


def _as_step(agreement: Agreement, reach_mm: float) -> Sequence[Fact]:
    cast = BrepCast(rays=_RAYS, seconds=0.0, against_design=agreement, against_mesh=agreement)
    return brep_criteria(cast, reach_mm)


def _form_error(
    grid: TableGrid, table: Float[np.ndarray, "side side"], fitted: TrimmedFace[Patch]
) -> Float[np.ndarray, "side side"]:
    """Table of the form error of a ``fitted`` face against the exact ``table``, continued unchanged beyond its edges.

    At the nodes of its ``grid`` a table is the exact surface, without a sum of basis functions.
    """
    within = to_sphere(fitted.domain.within(to_chart(grid.sample_directions()), tabulated=True))
    error_mm = fitted.shape.radius(within) - evaluate_table(grid, table, within)
    return grid.coefficients(error_mm[:, None]).reshape(table.shape)
