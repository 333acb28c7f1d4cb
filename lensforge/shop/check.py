"""The manufacturing check of the exported faces: the tools they need, the wall between them, findings for the shop."""

import time
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from lensforge.cad.boundary import Pair, sharpest_edges
from lensforge.cad.cutter_room import as_built, base_with_room
from lensforge.cad.face_tolerance import CHECKED
from lensforge.cad.flange import ring_of
from lensforge.cad.form_error import fit_lens
from lensforge.cad.part import SplineNodes
from lensforge.cad.patch import Patch
from lensforge.cad.plan import Plan, lay_out
from lensforge.cad.wall import Span, thickest, thinnest
from lensforge.results import Conditions
from lensforge.scene.lens import Lens
from lensforge.shop.ball_clearance import CustomBaseMesh, check_ball_clearance, read_base_mesh
from lensforge.shop.check_measures import Edge, Wall, Walls
from lensforge.shop.check_result import Check
from lensforge.shop.face_check import FaceCheck, MilledFace, face_result, measured_face, milled_face
from lensforge.shop.face_faults import PartAround, faults_of
from lensforge.shop.face_samples import OpticalFace, air_side
from lensforge.shop.mould_halves import Moulding
from lensforge.shop.tool_reach import check_tools, points_on_base
from lensforge.shop.turning import LatheTool, Points, turned_face
from lensforge.spec.accuracy import preset_of
from lensforge.spec.processes import Process

_RINGS = 401  # points of base and flange for a turning tool
_DECIMALS = 2  # of as many as are alike to 0.01 mm, one


def check_lens(lens: Lens, nodes: SplineNodes | None = None) -> Check:
    """Check ``lens`` for manufacture: the design by ``criteria``, which do not raise, the tools by ``verdicts``.

    ``nodes``: spline nodes across each face; by default as many as bring it within half a nanometre of the design, as
    the tolerance of a file leaves curvatures off by more than what a limit of a tool may be missed by. Raises
    :class:`InputError` where the file of its base is missing or does not hold a base.
    """
    started = time.perf_counter()
    manufacture = lens.spec.manufacture
    pair = fit_lens(lens, *([] if nodes is None else [nodes[name] for name in lens.surfaces]), tolerance=CHECKED)
    walls = _walls(pair)
    plan = lay_out(*pair, base_with_room(lens)) if manufacture.cuts == "lens" else None  # an insert has no base
    custom = None if plan is None or plan.base.file is None else read_base_mesh(plan.base.file)
    faces = _faces(lens, pair, None if plan is None else _fixture(lens, plan, custom))
    milled = {name: face for name, face in faces.items() if isinstance(face, MilledFace)}
    relief = check_ball_clearance(plan, custom, milled)
    tools = check_tools(manufacture.tools, milled, plan, custom, float(np.deg2rad(manufacture.max_tilt_deg)))
    results = {name: face_result(face, lens.spec) for name, face in faces.items()}
    moulding = Moulding.of(lens, pair) if manufacture.process == "moulded" else None
    sharpest = (edge for side in pair for edge in sharpest_edges(side))
    edges = tuple(Edge(**{**vars(edge), "point_mm": tuple(edge.point_mm.tolist())}) for edge in sharpest)
    return Check(
        lens=lens,
        inputs={"lens": lens.sha256},
        process=manufacture.process,
        scale=manufacture.scale,
        min_wall_mm=walls.thinnest.thickness_mm,
        walls=walls,
        relief=relief,
        tools=tools,
        edges=edges,
        mould=None if moulding is None else moulding.mould(),
        faults=faults_of(faces, PartAround(lens.spec, plan, custom, moulding)) if manufacture.making.is_judged else (),
        seconds=time.perf_counter() - started,
        chart_axis=next(iter(faces.values())).samples.grid.axis,
        **({} if lens.spec.plate is None else _room_on_plate(lens, pair)),
        **results,
    )


def check_made_by(lens: Lens, process: Process) -> Check:
    """Check ``lens`` as if made by ``process`` instead of the one in its spec.

    Raises :class:`InputError` if the process makes no such part.
    """
    judged = check_lens(as_built(lens, process))
    return judged.changed(lens=lens, inputs={"lens": lens.sha256}, conditions=Conditions.of(process=process))


def _room_on_plate(lens: Lens, pair: Pair[Patch]) -> dict[str, Any]:
    """Fields of a check for a plate that is cut: the gap between its lenses, and its thinnest wall."""
    from lensforge.cad.plate_export import room_on_plate

    gap_mm, wall = room_on_plate(lens, pair)
    of_wall = {} if wall is None else {"plate_wall_mm": wall.thickness_mm, "plate_wall_between": wall.between}
    return of_wall | {"plate_gap_mm": gap_mm if lens.spec.manufacture.cuts == "lens" else None}


def _fixture(lens: Lens, plan: Plan[Patch], custom: CustomBaseMesh | None) -> Points:
    """Distances from the axis and heights (mm) of base and flange of a lens that is turned."""
    parts = [np.empty((0, 2))]
    ring = ring_of(lens, plan.envelope)
    if custom is not None or plan.has_base:
        points = points_on_base(plan, _RINGS) if custom is None else custom.points()
        swept = np.column_stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]])
        parts.append(swept[np.unique(np.round(swept, _DECIMALS), axis=0, return_index=True)[1]])
    if ring is not None:
        share = np.linspace(0.0, 1.0, _RINGS)[:, None]
        parts += [(1.0 - share) * start + share * end for start, end in pairwise(ring.corners)]
    return np.concatenate(parts)


def _faces(lens: Lens, pair: Pair[Patch], fixture: Points | None) -> dict[str, FaceCheck]:
    """The faces, measured from their air side; a mould insert has air where the lens has material, and is scaled.

    ``fixture``: points of base and flange; None for a mould insert.
    """
    manufacture = lens.spec.manufacture
    length_mm = lens.spec.lens.drawn_mm
    drawn_mm = None if length_mm is None else manufacture.scale * length_mm
    nodes = preset_of(lens.accuracy).part.check_nodes
    measured = dict[str, FaceCheck]()
    at_lathe = np.empty((0, 2)) if fixture is None else fixture
    for boundary in pair:
        faces = {}
        for trimmed in boundary.faces:
            if not lens.body.face(trimmed.name).is_optical:
                continue
            cut = replace(trimmed.shape, control=manufacture.scale * trimmed.shape.control)
            sense = -1 if lens.spec.lens.role(trimmed.name).widens else 1
            air = air_side(lens.body.face(trimmed.name), manufacture)
            faces[trimmed.name] = OpticalFace(cut, air, trimmed.domain, sense=sense, drawn_mm=drawn_mm)
        for name, face in faces.items():
            whole = manufacture.cuts == "lens"  # each half of a mould has faces of its own
            beside = (other for other in faces.values() if other is not face and (whole or other.sense == face.sense))
            cut_face = replace(face, beside=tuple(beside))
            match lens.spec.cutting(name):
                case "milled":
                    measured[name] = milled_face(cut_face, manufacture.cutter_radius_mm, nodes)
                case "turned" if lens.spec.lens.is_revolved(name):
                    measured[name] = turned_face(measured_face(cut_face, nodes), LatheTool.of(manufacture), at_lathe)
                case _:
                    measured[name] = measured_face(cut_face, nodes)
    return {name: measured[name] for name in lens.surfaces if name in measured}


def _walls(pair: Pair[Patch]) -> Walls:
    return Walls(thinnest=_wall(thinnest(*pair)), thickest=_wall(thickest(*pair)))


def _wall(span: Span) -> Wall:
    near, far = (tuple(point.tolist()) for point in (span.cavity_mm, span.envelope_mm))
    return Wall(thickness_mm=span.thickness_mm, cavity_point_mm=near, envelope_point_mm=far)
