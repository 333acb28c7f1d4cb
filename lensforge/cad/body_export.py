"""A body of faces as mesh and solid, its STEP, STL and 3MF files, and their errors, measured by reading them back.

Nothing here asks how the faces were found: a body of given faces needs no spec.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from lensforge.cad.boundary import Pair, boundaries
from lensforge.cad.custom_base import CustomBase, join_base, join_mesh
from lensforge.cad.facets import CHORD_MM
from lensforge.cad.flange import FlangeRing
from lensforge.cad.form_error import FormError, face_error, fit_boundaries
from lensforge.cad.mesh import MIN_RINGS, BodyMesh, Closure, build_mesh, check_closed, mesh_error, rings_for
from lensforge.cad.mesh_files import parse_3mf, parse_stl, stl_bytes, threemf_bytes
from lensforge.cad.patch import Patch
from lensforge.cad.plan import BORE, BOTTOM, FLANGE_SIDE, FOOT_END, FOOT_SIDE, POCKET_SIDE, SIDE, Plan, make_plan
from lensforge.cad.plate_layout import RoundWall
from lensforge.cad.plate_mesh import MeshParts, add_round
from lensforge.cad.solid import Solid, build_solid
from lensforge.cad.step import parse_step, step_bytes
from lensforge.kernels.parallel import in_parallel_map
from lensforge.scene.body import Body
from lensforge.spec import BaseSection
from lensforge.surfaces.surface import Surface

_NO_BASE = BaseSection(kind="none")


@dataclass(frozen=True, eq=False)
class BuiltBody:
    """Surfaces, plan, mesh and solid of a body, and the largest distance (mm) of the mesh's facets from its faces."""

    surfaces: Mapping[str, Surface]
    plan: Plan[Patch]
    mesh: BodyMesh
    chord_mm: float
    solid: Solid

    @property
    def nodes(self) -> Mapping[str, int]:
        """Nodes across the spline of each face, by its name."""
        return {face.name: face.shape.nodes for face in (*self.plan.cavity.faces, *self.plan.envelope.faces)}

    def prove(self, step: bytes, stl: bytes, threemf: bytes) -> "BodyProof":
        """Read the files of the body back, and compare their faces with the surfaces."""
        return prove(self, step, stl, threemf)

    def files(self, product: str) -> tuple[bytes, bytes, bytes]:
        """The STEP (AP214), STL and 3MF file."""
        return step_bytes(self.solid, product), stl_bytes(self.mesh), threemf_bytes(self.mesh, product)


@dataclass(frozen=True)
class BodyProof:
    """The files as read back; the form error of each face by its name."""

    solid: Solid
    stl: Closure
    threemf: Closure
    form: Mapping[str, FormError]


def build_body(
    body: Body,
    base: BaseSection = _NO_BASE,
    *,
    nodes: Mapping[str, int] | None = None,
    rings: int | None = None,
    chord_mm: float = CHORD_MM,
) -> BuiltBody:
    """Make mesh and solid of ``body`` on ``base``, by default without one; lengths missing in ``base`` are 0.

    ``nodes``: of the spline of each face by its name, by default as many as its form needs. ``rings``, ``chord_mm``: of
    the mesh, as for ``build_part``. Raises :class:`InputError` for faces that are not nested about the axis or leave no
    wall, and for a base that does not hold the cavity.
    """
    pair = fit_boundaries(boundaries(body), nodes or {})
    return on_base({face.name: face.surface for face in body.faces}, pair, base, rings, chord_mm)


def on_base(
    surfaces: Mapping[str, Surface],
    pair: Pair[Patch],
    base: BaseSection,
    rings: int | None,
    chord_mm: float,
    custom: CustomBase | None = None,
    ring: FlangeRing | None = None,
    least_rings: int = MIN_RINGS,
) -> BuiltBody:
    """The body of fitted boundaries with the ``ring`` of its flange, joined to a ``custom`` base.

    ``least_rings``: lower limit if ``rings`` are not given.
    """
    plan = make_plan(*pair, base, ring)
    if rings is None:
        mesh = build_mesh(plan, rings_for(plan, chord_mm, least_rings), chord_mm)
    else:
        mesh = build_mesh(plan, rings)
    reached_mm = mesh_error(mesh, plan)
    solid = solid_on_base(plan, custom)
    mesh = _with_feet(mesh, plan)
    if custom is not None:
        mesh = join_mesh(mesh, custom, reached_mm)
    return BuiltBody(surfaces, plan, mesh, reached_mm, solid)


def _with_feet(mesh: BodyMesh, plan: Plan[Patch]) -> BodyMesh:
    """The mesh of a body on the base of ``plan`` with its feet, around which the bottom's plane is cut out."""
    feet = plan.base.feet
    height_mm = plan.base.height_mm
    if feet is None:
        return mesh
    parts = MeshParts()
    parts.add_points(mesh.vertices)
    for name in mesh.names:
        if name != BOTTOM:
            parts.add_facets(name, mesh.part(name))
    outline, opening = (_loop(mesh, names) for names in ((FLANGE_SIDE, SIDE), (POCKET_SIDE, BORE)))
    tops = []
    for place in feet.places_mm:
        wall = RoundWall(place, *plan.base.foot_radii_mm, height_mm, feet.height_mm)
        top, end = add_round(parts, FOOT_SIDE, wall, CHORD_MM, outwards=True)
        parts.add_plane(FOOT_END, end, [], up=False)
        tops.append(top)
    parts.add_plane(BOTTOM, outline, [opening, *tops], up=False)
    return parts.mesh(mesh.rings)


def _loop(mesh: BodyMesh, names: tuple[str, str]) -> Int[np.ndarray, " n"]:
    """Vertices of the bottom at the first of ``names`` that the mesh has, counter-clockwise."""
    beside = next(name for name in names if name in mesh.names)
    ids = np.intersect1d(mesh.part(BOTTOM), mesh.part(beside))
    return ids[np.argsort(np.arctan2(mesh.vertices[ids, 1], mesh.vertices[ids, 0]), kind="stable")]


def solid_on_base(plan: Plan[Patch], base: CustomBase | None) -> Solid:
    """The solid of ``plan``, joined with ``base`` if that comes from a file."""
    solid = build_solid(plan)
    return solid if base is None else join_base(solid, base)


def prove(body: BuiltBody, step: bytes, stl: bytes, threemf: bytes) -> BodyProof:
    """Read the files of ``body`` back, and compare their faces with the surfaces, each over its domain."""
    solid = parse_step(step)
    faces = [face for face in body.plan.faces if not face.is_flange]
    errors = in_parallel_map(
        lambda face: face_error(body.surfaces[face.name], solid.faces[face.label], domain=face.domain), faces
    )
    form = dict(zip((face.name for face in faces), errors, strict=True))
    return BodyProof(solid, check_closed(*parse_stl(stl)), check_closed(*parse_3mf(threemf)), form)
