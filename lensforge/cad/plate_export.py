"""The plate from the faces of a lens of each kind: STEP, STL and 3MF, and their errors, measured by reading them back.

Each lens in the solid as read back is compared with the one of its kind, whose form error is known: two splines of the
same knots are no farther apart than their poles. The volume is compared with its closed form.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from OCP.BRep import BRep_Tool
from OCP.BRepGProp import BRepGProp, BRepGProp_Domain, BRepGProp_Face, BRepGProp_Vinert
from OCP.Geom import Geom_BSplineSurface
from OCP.gp import gp_Pnt
from OCP.GProp import GProp_GProps

from lensforge.cad.boundary import Pair
from lensforge.cad.face_tolerance import FaceTolerance
from lensforge.cad.form_error import face_error, fit_lens, worst
from lensforge.cad.mesh import BodyMesh, check_closed, manifold_of, mesh_error
from lensforge.cad.mesh_files import parse_3mf, parse_stl, stl_bytes, threemf_bytes
from lensforge.cad.part_limits import mass_g, mesh_volume_limit
from lensforge.cad.patch import Patch
from lensforge.cad.plan import MIN_BASE_WALL_MM, Plan, lay_out, rim_points
from lensforge.cad.plate_layout import (
    BOSS_BORE,
    BOSS_ROOF,
    PIN_END,
    PIN_SIDE,
    PLATE_BORE,
    PLATE_BOTTOM,
    PLATE_HOLE,
    PLATE_SIDE,
    PlateLayout,
    PlateWall,
    layout_of,
)
from lensforge.cad.plate_mesh import build_plate_mesh, lens_meshes
from lensforge.cad.plate_result import PLATE_FILES, PLATE_STEP_FILE, Plate
from lensforge.cad.plate_solid import build_plate_solid
from lensforge.cad.solid import Shapes, build_solid
from lensforge.cad.step import parse_step, signed_step
from lensforge.errors import InputError
from lensforge.results.brep_size import spline_poles
from lensforge.results.files import MIB
from lensforge.results.record import MOST_FILE_BYTES
from lensforge.scene.lens import Lens
from lensforge.spec import BaseSection
from lensforge.spec.lamps_section import Lamps, Place
from lensforge.surfaces.step_file import Schema, parts_of

_BARE = BaseSection(kind="none")
_NEIGHBOURS = 1.5  # of the distance of the nearest two axes: lenses this close may be the closest two
_CLOSEST = 64  # vertices, and facets of each, among which the closest are found
_NM_PER_MM = 1e6
_WALL_ERROR = 1e-5  # relative, as the kernel estimates it; it is a hundred times less


@dataclass(frozen=True, eq=False)
class LensOfPlate:
    """The lens of one kind: its fitted faces, their form error, and the volume of its solid without a base."""

    plan: Plan[Patch]
    form_error_nm: float
    volume_mm3: float

    @staticmethod
    def fitted(lens: Lens, nodes: int | None, tolerance: FaceTolerance) -> "LensOfPlate":
        """Fit the faces of ``lens`` with ``nodes``, or as its ``tolerance`` needs."""
        pair = fit_lens(lens, *([] if nodes is None else [nodes] * len(lens.surfaces)), tolerance=tolerance)
        plan = lay_out(*pair, _BARE)
        solid = build_solid(plan)
        errors = [
            face_error(lens.surfaces[face.name], solid.faces[face.label], domain=face.domain) for face in plan.faces
        ]
        return LensOfPlate(plan, worst(errors).form_max_nm, solid.volume_mm3)


@dataclass(frozen=True, eq=False)
class BuiltPlate:
    """Figures, and files by their names."""

    figures: Plate
    files: dict[str, bytes]


def build_plate(
    lens: Lens, first_lens: LensOfPlate, nodes: int | None, tolerance: FaceTolerance, schema: Schema, date: str | None
) -> BuiltPlate | None:
    """Make the plate of the spec; None if ``lens`` is not on a plate.

    ``first_lens``: ``lens`` as exported by itself. ``nodes``, ``tolerance``: of the faces of all kinds. Raises
    :class:`InputError` for lenses that overlap, a pin in a cavity, and a file that would be too large.
    """
    start = time.perf_counter()
    layout = layout_of(lens)
    if layout is None or not lens.makes_plate:
        return None
    kinds = [first_lens, *(LensOfPlate.fitted(kind, nodes, tolerance) for kind in lens.kinds[1:])]
    plans = [kind.plan for kind in kinds]
    volumes = [kind.volume_mm3 for kind in kinds]
    product = f"{lens.spec.name} plate"
    openings = [rim_points(plan.cavity) for plan in plans]
    _require_walls(layout, openings)
    facets, chord_mm = lens_meshes(tuple(plans), layout.lenses.kind_of_each)
    gap_mm = least_gap_mm(facets, layout)
    solid = build_plate_solid(plans, layout)
    step = signed_step(solid, lens.spec, product, schema, date).content
    _require_readable(step, len(layout.lenses))
    mesh = build_plate_mesh(plans, layout, facets, chord_mm)
    stl = stl_bytes(mesh)
    threemf = threemf_bytes(mesh, product)
    files = dict(zip(PLATE_FILES, (step, stl, threemf), strict=True))
    volume = layout.volume_mm3(volumes, openings)
    read = parse_step(step)
    closed = check_closed(*parse_stl(stl, PLATE_FILES[1]))
    in_3mf = check_closed(*parse_3mf(threemf, PLATE_FILES[2]))
    form_nm = max(kind.form_error_nm for kind in kinds) + copies_off_mm(read.faces, plans, layout) * _NM_PER_MM
    figures = Plate(
        lenses=len(layout.lenses),
        gap_mm=gap_mm,
        form_error_nm=form_nm,
        step_valid=read.valid,
        step_volume_change=abs(read.default_volume_mm3 / solid.default_volume_mm3 - 1.0),
        volume_error=abs(volume_of_mm3(read.faces, layout, volumes) / volume - 1.0),
        volume_mm3=volume,
        volume_mesh_mm3=closed.volume_mm3,
        mesh_volume_limit=mesh_volume_limit(mesh.area(), chord_mm, volume),
        mass_g=mass_g(lens.spec, volume),
        bounds_mm=mesh.bounds_mm,
        watertight=closed.watertight,
        watertight_3mf=in_3mf.watertight,
        genus=closed.genus,
        genus_difference=abs(closed.genus - read.genus),
        faces=len(parts_of(read.shape, "FACE")),
        triangles=len(mesh.triangles),
        chord_error_um=1e3 * max(mesh_error(*facets_and_plan) for facets_and_plan in zip(facets, plans, strict=True)),
        seconds=round(time.perf_counter() - start, 3),
        invalid_faces=read.faults,
    )
    return BuiltPlate(figures, files)


def _require_walls(layout: PlateLayout, openings: Sequence[Float[np.ndarray, "n 2"]]) -> None:
    wall = layout.thinnest_wall(openings)
    if wall is not None and wall.thickness_mm < MIN_BASE_WALL_MM:
        raise InputError(
            f"plate: the wall between {wall.between} is {wall.thickness_mm:.4g} mm; allowed: at least "
            f"{MIN_BASE_WALL_MM:g}; move one of the two, or lower its diameter, plate.draft_deg or thickness_mm"
        )


def _require_readable(step: bytes, lenses: int) -> None:
    if len(step) > MOST_FILE_BYTES:
        raise InputError(
            f"{PLATE_STEP_FILE}: {len(step) // MIB} MiB for {lenses} lenses, at most {MOST_FILE_BYTES // MIB} MiB "
            "are read; take fewer lenses on a plate, or export with fewer --nodes"
        )


def room_on_plate(lens: Lens, pair: Pair[Patch]) -> tuple[float | None, PlateWall | None]:
    """Least gap (mm) between two lenses of a plate, and its thinnest wall at holes and pins; None if absent.

    ``pair``: fitted faces of ``lens``.
    """
    layout = layout_of(lens)
    if layout is None or not lens.makes_plate:
        return None, None
    plans = tuple(lay_out(*fitted, _BARE) for fitted in (pair, *map(fit_lens, lens.kinds[1:])))
    facets, _ = lens_meshes(plans, layout.lenses.kind_of_each)
    return least_gap_mm(facets, layout), layout.thinnest_wall([rim_points(plan.cavity) for plan in plans])


def volume_of_mm3(faces: Shapes, layout: PlateLayout, lenses_mm3: Sequence[float]) -> float:
    """Volume (mm^3) within ``faces``, by the divergence theorem.

    ``lenses_mm3``: contributions of a lens of each kind, the same at each place, as its faces close a body with a
    level. A level contributes by its area, z = 0 nothing.
    """
    volume_mm3 = sum(layout.of_each(lenses_mm3))
    for name, face in faces.items():
        if name.startswith((PLATE_BOTTOM, PIN_END, BOSS_ROOF)):
            volume_mm3 -= _down_to_zero_mm3(face) / 3.0
        elif name.startswith((PLATE_SIDE, PLATE_BORE, PLATE_HOLE, PIN_SIDE, BOSS_BORE)):
            volume_mm3 += _to_origin_mm3(face)
    return volume_mm3


def _to_origin_mm3(wall: Any) -> float:
    """Volume between a wall and the origin, negative if its normal points there.

    The plain formula without an error bound would take too few points, and its error grows with the distance.
    """
    faced = BRepGProp_Face(wall)
    trim = BRepGProp_Domain(wall)
    return float(BRepGProp_Vinert(faced, trim, gp_Pnt(0.0, 0.0, 0.0), _WALL_ERROR).Mass())


def _down_to_zero_mm3(level: Any) -> float:
    """Volume between a level face and z = 0, negative below it."""
    area = GProp_GProps()
    BRepGProp.SurfaceProperties_s(level, area)
    return float(area.Mass() * BRep_Tool.Pnt_s(parts_of(level, "VERTEX")[0]).Z())


def copies_off_mm(faces: Shapes, plans: Sequence[Plan[Patch]], layout: PlateLayout) -> float:
    """Largest distance (mm) of the optical ``faces`` of a plate's solid from those of the lens of each place.

    Infinite if a face is missing, or is no spline with as many poles.
    """
    count = len(layout.lenses)
    off = 0.0
    for number, plan in enumerate(layout.of_each(plans)):
        for face in plan.faces:
            poles = face.shape.bounded(face.domain.extent[1]).control
            matching_face = faces.get(face.label if count == 1 else f"{face.label}_{number + 1}")
            read = None if matching_face is None else _poles_of(matching_face)
            if read is None or read.shape != poles.shape:
                return float("inf")
            wanted = layout.placed(poles.reshape(-1, 3), number)
            off = max(off, float(np.linalg.norm(read.reshape(-1, 3) - wanted, axis=1).max()))
    return off


def _poles_of(face: Any) -> Float[np.ndarray, "n n 3"] | None:
    """Poles (mm) of the spline on which a face lies, at its place; None if it lies on no spline."""
    surface = BRep_Tool.Surface_s(face)
    return spline_poles(surface) if isinstance(surface, Geom_BSplineSurface) else None


def least_gap_mm(kinds: Sequence[BodyMesh], layout: PlateLayout) -> float | None:
    """Least distance (mm) between two lenses: from a vertex of one to the facets of the other; None for one lens.

    ``kinds``: a lens of each. Raises :class:`InputError` if two overlap.
    """
    bodies = [manifold_of(lens.vertices, lens.triangles) for lens in kinds]
    gaps = list[float]()
    for way, turn, (kind, neighbour_kind) in _neighbours(layout):
        beside = replace(layout, lenses=Lamps.level([way], [turn]))
        vertices = beside.placed(kinds[neighbour_kind].vertices, 0)
        if (bodies[kind] ^ manifold_of(vertices, kinds[neighbour_kind].triangles)).volume() > 0.0:
            raise InputError(
                f"plate: two lenses, {np.hypot(*way):.4g} mm apart, overlap; raise the pitch of lamps, or lower "
                "constraints.max_radius_mm and design again"
            )
        gaps.append(_between_mm(vertices, kinds[kind]))
    return min(gaps, default=None)


def _between_mm(points: Float[np.ndarray, "n 3"], lens: BodyMesh) -> float:
    """Least distance (mm) of ``points`` from those facets of ``lens`` that are nearest by their vertices."""
    import trimesh
    from scipy.spatial import cKDTree

    near = points[np.argsort(cKDTree(lens.vertices).query(points)[0])[:_CLOSEST]]
    corners = lens.vertices[lens.triangles]
    facets = corners[cKDTree(corners.mean(axis=1)).query(near, k=_CLOSEST)[1].ravel()]
    repeated = np.repeat(near, _CLOSEST, axis=0)
    return float(np.linalg.norm(trimesh.triangles.closest_point(facets, repeated) - repeated, axis=1).min())


def _neighbours(layout: PlateLayout) -> Iterator[tuple[Place, float, tuple[int, int]]]:
    """Places (mm) and turns (degrees) of lenses in a neighbour's local coordinates, without duplicates.

    With both kinds, the neighbour's first.
    """
    lenses = layout.lenses
    kinds = layout.lenses.kind_of_each
    seen = set[tuple[float, float, float, int, int]]()
    places = np.array([lens.place_mm for lens in lenses.lamps])
    turns = np.array(lenses.turns_deg)
    for number, lens in enumerate(lenses.lamps):
        ways = lens.pose.to_local_points(places)
        near = np.flatnonzero(np.hypot(*ways.T[:2]) <= _NEIGHBOURS * lenses.nearest_mm())
        for neighbour in near[near != number]:
            x, y, turned = np.round((*ways[neighbour, :2], (turns[neighbour] - lens.turn_deg) % 360.0), 6).tolist()
            neighbours = x, y, turned, kinds[number], kinds[neighbour]
            if neighbours not in seen:
                seen.add(neighbours)
                yield (x, y), turned, neighbours[3:]
