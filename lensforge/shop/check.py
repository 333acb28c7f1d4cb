"""The manufacturing check of the exported faces: the tools they need, the wall between them, findings for the shop."""

import time
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lensforge.cad.cutter_room import base_with_room
from lensforge.cad.form_error import fit_faces
from lensforge.cad.part import Part, SplineNodes
from lensforge.cad.plan import lay_out
from lensforge.cad.wall import Span, thickest, thinnest
from lensforge.scene.lens import Lens
from lensforge.shop.ball_clearance import check_ball_clearance, read_base_mesh
from lensforge.shop.check_result import Check, FaceName, Wall, Walls
from lensforge.shop.face_check import FaceCheck, check_face, face_result
from lensforge.shop.face_samples import AirSide, OpticalFace
from lensforge.shop.findings import check_findings, wall_criteria
from lensforge.shop.tool_reach import check_tools


def check_part(part: Part) -> Check:
    """Check the part for manufacture: the faces of its lens, with the spline nodes of the export."""
    return check_lens(part.lens, part.nodes)


def check_lens(lens: Lens, nodes: SplineNodes | None = None) -> Check:
    """Check ``lens`` for manufacture: the design by ``criteria``, which do not raise, the tools by ``verdicts``.

    ``nodes``: spline nodes across each face, by default those that an export would choose. Raises
    :class:`InputError` where the file of its base is missing or does not hold a base.
    """
    started = time.perf_counter()
    manufacture = lens.spec.manufacture
    inner, outer = _faces(lens, nodes)
    walls = _walls(inner, outer, manufacture.scale)
    patches = inner.samples.face.patch, outer.samples.face.patch
    plan = lay_out(*patches, base_with_room(lens)) if manufacture.make == "part" else None  # an insert has no base
    custom = None if plan is None or plan.base.file is None else read_base_mesh(plan.base.file)
    relief = check_ball_clearance(plan, custom, inner, outer)
    tools = check_tools(manufacture.tools, inner, outer, plan, custom, float(np.deg2rad(manufacture.max_tilt_deg)))
    faces = face_result(inner), face_result(outer)
    return Check(
        inputs={"lens": lens.sha256},
        make=manufacture.make,
        scale=manufacture.scale,
        inner=faces[0],
        outer=faces[1],
        min_wall_mm=walls.thinnest.thickness_mm,
        wall=walls,
        relief=relief,
        tools=tools,
        criteria=wall_criteria(lens.spec, walls),
        verdicts=check_findings(lens.spec, *faces, walls.thinnest.thickness_mm, relief, tools),
        seconds=time.perf_counter() - started,
        chart_axis=inner.samples.grid.axis,
        **_maps("inner", inner),
        **_maps("outer", outer),
    )


def _maps(name: FaceName, face: FaceCheck) -> dict[str, Float[np.ndarray, "n n *c"]]:
    """Values per sample as maps over the chart of the face, NaN outside its rim."""
    curvatures = face.samples.curvatures
    values = {
        "xyz": face.samples.points,
        "sag_mm": face.sag_mm,
        "kappa_min": curvatures.minimum,
        "kappa_max": curvatures.maximum,
        "residual_mm": face.residual_mm,
    }
    return {f"{name}_{key}": face.samples.grid.to_map(each) for key, each in values.items()}


def _faces(lens: Lens, nodes: SplineNodes | None) -> tuple[FaceCheck, FaceCheck]:
    """Both faces, measured from their air side; a mould insert has air where the lens has material, and is scaled."""
    manufacture = lens.spec.manufacture
    is_part, cutter_mm, scale = manufacture.make == "part", manufacture.cutter_radius_mm, manufacture.scale
    inside, outside = (AirSide.INSIDE, AirSide.OUTSIDE) if is_part else (AirSide.OUTSIDE, AirSide.INSIDE)
    inner, outer = fit_faces(lens) if nodes is None else fit_faces(lens, nodes.inner, nodes.outer)
    inner, outer = (replace(face, control=scale * face.control) for face in (inner, outer))
    return (
        check_face(OpticalFace(inner, inside), cutter_mm),
        check_face(OpticalFace(outer, outside), cutter_mm),
    )


def _walls(inner: FaceCheck, outer: FaceCheck, scale: float) -> Walls:
    """Walls of the lens itself: ``scale`` is that of the faces against the lens's."""
    faces = inner.samples.face.patch, outer.samples.face.patch
    return Walls(thinnest=_of_lens(thinnest(*faces), scale), thickest=_of_lens(thickest(*faces), scale))


def _of_lens(wall: Span, scale: float) -> Wall:
    """A wall between the faces of a mould, ``scale`` times the lens's, as that of the lens."""
    inner, outer = (tuple((point / scale).tolist()) for point in (wall.inner_mm, wall.outer_mm))
    return Wall(thickness_mm=wall.thickness_mm / scale, inner_point_mm=inner, outer_point_mm=outer)
