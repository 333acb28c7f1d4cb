"""The manufacturing check: what both faces ask of a tool, the wall between them, and what the shop can do."""

import time

import numpy as np
from jaxtyping import Float

from lensforge.gates import Gate, at_least
from lensforge.geometry.part import Part
from lensforge.lens import Lens
from lensforge.manufacturing.cut import Check, FaceResult, Relief, Scallop, Scallops, ToolResult, Wall, Walls
from lensforge.manufacturing.face import AirSide, nodes_for, tabulate_face
from lensforge.manufacturing.face_check import FaceCheck, check_face, face_result
from lensforge.manufacturing.judgement import (
    Side,
    cutter_verdict,
    draft_verdict,
    relief_verdicts,
    tilt_verdict,
    tool_verdicts,
    wall_verdict,
)
from lensforge.manufacturing.own_base import read_own_base
from lensforge.manufacturing.relief_check import check_relief
from lensforge.manufacturing.scallop import scallop
from lensforge.manufacturing.tooling import check_tools
from lensforge.manufacturing.verdicts import ShopVerdict
from lensforge.manufacturing.wall import normal_wall_mm, radial_wall_mm, thinnest


def check_part(part: Part) -> Check:
    """Check the part for manufacture: its lens, whose faces the files have been proven to be."""
    return check_lens(part.lens)


def check_lens(lens: Lens) -> Check:
    """Check ``lens`` for manufacture; ``gates`` judge the design and do not raise, ``verdicts`` judge the tools.

    Raises :class:`InputError` where the file of its base is missing or no base.
    """
    started = time.perf_counter()
    manufacture = lens.spec.manufacture
    inner, outer = _faces(lens)
    walls = _walls(inner, outer)
    base = lens.spec.base if manufacture.make == "part" else None  # a mould insert has none
    own = None if base is None or base.file is None else read_own_base(base.file)
    relief = check_relief(base, own, manufacture.cutter_radius_mm, inner, outer)
    tools = check_tools(manufacture.tools, inner, outer, base, own, float(np.deg2rad(manufacture.max_tilt_deg)))
    faces = face_result(inner), face_result(outer)
    min_wall_mm = min(walls.radial.thickness_mm, walls.normal.thickness_mm)  # at a rim the radial one may win
    return Check(
        inputs={"lens": lens.sha256},
        make=manufacture.make,
        inner=faces[0],
        outer=faces[1],
        min_wall_mm=min_wall_mm,
        wall=walls,
        relief=relief,
        scallop=_scallops(lens, inner, outer),
        tools=tools,
        gates=(_radial_gate(lens, walls.radial),),
        verdicts=_verdicts(lens, *faces, min_wall_mm, relief, tools),
        seconds=time.perf_counter() - started,
        chart_axis=inner.samples.grid.axis,
        inner_xyz=_map(inner, inner.samples.points),
        inner_sag_mm=_map(inner, inner.sphere.deviation_mm),
        inner_kappa_min=_map(inner, inner.samples.curvatures.minimum),
        inner_kappa_max=_map(inner, inner.samples.curvatures.maximum),
        inner_residual_mm=_map(inner, inner.residual_mm),
        inner_reachable=_map(inner, inner.reached.astype(np.float64)),
        outer_xyz=_map(outer, outer.samples.points),
        outer_sag_mm=_map(outer, outer.sphere.deviation_mm),
        outer_kappa_min=_map(outer, outer.samples.curvatures.minimum),
        outer_kappa_max=_map(outer, outer.samples.curvatures.maximum),
        outer_residual_mm=_map(outer, outer.residual_mm),
        outer_reachable=_map(outer, outer.reached.astype(np.float64)),
    )


def _map(face: FaceCheck, values: Float[np.ndarray, "k *c"]) -> Float[np.ndarray, "n n *c"]:
    """Values per sample over the chart of the face, NaN outside of its rim."""
    return face.samples.grid.to_map(values)


def _faces(lens: Lens) -> tuple[FaceCheck, FaceCheck]:
    """Both faces, measured from the side where their air is: a mould insert has it where the lens has its material."""
    is_part, cutter_mm = lens.spec.manufacture.make == "part", lens.spec.manufacture.cutter_radius_mm
    inside, outside = (AirSide.INSIDE, AirSide.OUTSIDE) if is_part else (AirSide.OUTSIDE, AirSide.INSIDE)
    return (
        check_face("inner", tabulate_face(lens.inner, inside, nodes_for(lens.inner)), cutter_mm),
        check_face("outer", tabulate_face(lens.outer, outside, nodes_for(lens.outer)), cutter_mm),
    )


def _walls(inner: FaceCheck, outer: FaceCheck) -> Walls:
    samples, face = inner.samples, outer.samples.face
    rays = samples.points / np.linalg.norm(samples.points, axis=1, keepdims=True)
    return Walls(
        normal=thinnest(samples, normal_wall_mm(samples, face), samples.outward),
        radial=thinnest(samples, radial_wall_mm(samples, face), rays),
    )


def _radial_gate(lens: Lens, radial: Wall) -> Gate:
    """The wall that the design promised: the radial one of the paper. The material may be thinner along the normal."""
    place = ", ".join(f"{value:.4g}" for value in radial.inner_point_mm)
    limit = lens.spec.constraints.min_thickness_mm - lens.spec.constraints.tolerance_mm
    remedy = f"raise lens.outer_offset_mm or give the last level more steps; it is thinnest at ({place}) mm"
    return at_least("radial wall", radial.thickness_mm, limit, "mm", remedy)


def _scallops(lens: Lens, inner: FaceCheck, outer: FaceCheck) -> Scallops:
    """Cusps where the face is most convex: there they are highest and steepest."""
    manufacture = lens.spec.manufacture
    cutter_mm, limit_rad = manufacture.cutter_radius_mm, 1e-3 * manufacture.slope_limit_mrad

    def of(face: FaceCheck) -> Scallop:
        kappa = max(float(face.samples.curvatures.maximum.max()), -1.0 / cutter_mm)
        return scallop(cutter_mm, manufacture.stepover_mm, limit_rad, kappa)

    return Scallops(
        stepover_mm=manufacture.stepover_mm,
        slope_limit_mrad=manufacture.slope_limit_mrad,
        inner=of(inner),
        outer=of(outer),
    )


def _verdicts(
    lens: Lens, inner: FaceResult, outer: FaceResult, wall_mm: float, relief: Relief, tools: tuple[ToolResult, ...]
) -> tuple[ShopVerdict, ...]:
    allowed_deg = lens.spec.manufacture.max_tilt_deg
    faces: tuple[tuple[Side, FaceResult], ...] = (("inner", inner), ("outer", outer))
    return (
        *(cutter_verdict(name, face.cutter) for name, face in faces),
        *relief_verdicts(relief),
        *(tilt_verdict(name, face.largest_tilt_deg, allowed_deg) for name, face in faces),
        wall_verdict(wall_mm, lens.spec.constraints.min_thickness_mm),
        *(draft_verdict(name, face) for name, face in faces),
        *(verdict for tool in tools for verdict in tool_verdicts(tool)),
    )
