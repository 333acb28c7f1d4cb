"""The manufacturing check of one lens: ``check.json`` with the numbers, ``check.npz`` with the maps."""

import time
from pathlib import Path
from typing import Any

import numpy as np

from lensforge.files import replacing, write_json
from lensforge.gates import Gate
from lensforge.lens import Lens
from lensforge.manufacturing.draft import draft_rad, largest_tilt_rad, undercut_fraction
from lensforge.manufacturing.face import AirSide, nodes_for, tabulate_face
from lensforge.manufacturing.face_check import FaceCheck, check_face, face_json
from lensforge.manufacturing.own_base import OwnBase, read_own_base
from lensforge.manufacturing.relief_check import check_relief, relief_verdicts
from lensforge.manufacturing.scallop import scallop_height_mm, scallop_slope_rad, stepover_for_slope_mm
from lensforge.manufacturing.tooling import check_tools, tool_verdicts
from lensforge.manufacturing.verdicts import (
    ShopVerdict,
    cutter_verdict,
    draft_verdict,
    tilt_verdict,
    wall_verdict,
)
from lensforge.manufacturing.wall import ThinnestWall, normal_wall_mm, radial_wall_mm, thinnest
from lensforge.spec import BaseSection


def check_lens(lens: Lens, directory: Path) -> dict[str, Any]:
    """Check ``lens`` for manufacture; write check.json and check.npz into ``directory`` and return the former.

    ``gates`` judge the design and do not raise; ``verdicts`` judge the tools. Raises
    :class:`~lensforge.errors.InputError` when the folder cannot be written.
    """
    started = time.perf_counter()
    cutter_mm = lens.spec.manufacture.cutter_radius_mm
    # A mould insert has its air where the lens has its material.
    inside, outside = (AirSide.INSIDE, AirSide.OUTSIDE) if _is_part(lens) else (AirSide.OUTSIDE, AirSide.INSIDE)
    inner = check_face("inner", tabulate_face(lens.inner, inside, nodes_for(lens.inner)), cutter_mm)
    outer = check_face("outer", tabulate_face(lens.outer, outside, nodes_for(lens.outer)), cutter_mm)
    radial, normal = _walls(inner, outer)
    thinner = min(radial, normal, key=lambda wall: wall.thickness_mm)  # at a rim the radial one may win
    base = lens.spec.base if _is_part(lens) else None  # a mould insert has none
    own = None if base is None or base.file is None else read_own_base(base.file)
    relief = check_relief(base, own, cutter_mm, inner, outer)
    tools = _tools_json(lens, inner, outer, base, own)
    content: dict[str, Any] = {
        "make": lens.spec.manufacture.make,
        "inner": face_json(inner),
        "outer": face_json(outer),
        "min_wall_mm": thinner.thickness_mm,
        "wall": {"normal": _wall_json(normal), "radial": _wall_json(radial)},
        "relief": relief,
        "scallop": _scallop_json(lens, inner, outer),
        "tools": tools,
        "gates": [_radial_gate(lens, radial).to_json()],
        "verdicts": [verdict.to_json() for verdict in _verdicts(lens, inner, outer, thinner, relief)]
        + [verdict.to_json() for verdict in tool_verdicts(tools)],
        "seconds": time.perf_counter() - started,
    }
    _write_maps(directory / "check.npz", inner, outer)
    write_json(directory / "check.json", content)
    return content


def _is_part(lens: Lens) -> bool:
    return lens.spec.manufacture.make == "part"


def _tools_json(
    lens: Lens, inner: FaceCheck, outer: FaceCheck, base: BaseSection | None, own: OwnBase | None
) -> list[dict[str, Any]]:
    manufacture = lens.spec.manufacture
    return check_tools(manufacture.tools, (inner, outer), base, own, float(np.deg2rad(manufacture.max_tilt_deg)))


def _walls(inner: FaceCheck, outer: FaceCheck) -> tuple[ThinnestWall, ThinnestWall]:
    """The thinnest wall along the ray from the origin, and along the cavity's normal."""
    samples, face = inner.samples, outer.samples.face
    rays = samples.points / np.linalg.norm(samples.points, axis=1, keepdims=True)
    radial = thinnest(samples, radial_wall_mm(samples, face), rays)
    return radial, thinnest(samples, normal_wall_mm(samples, face), samples.outward)


def _wall_json(wall: ThinnestWall) -> dict[str, Any]:
    return {
        "thickness_mm": wall.thickness_mm,
        "inner_point_mm": wall.inner_mm.tolist(),
        "outer_point_mm": wall.outer_mm.tolist(),
    }


def _radial_gate(lens: Lens, radial: ThinnestWall) -> Gate:
    """The wall that the design promised: the radial one of the paper. The material may be thinner along the normal."""
    place = ", ".join(f"{value:.4g}" for value in radial.inner_mm)
    return Gate(
        name="radial wall",
        value=radial.thickness_mm,
        sense=">=",
        limit=lens.spec.constraints.min_thickness_mm - lens.spec.constraints.tolerance_mm,
        unit="mm",
        remedy=f"raise lens.outer_offset_mm or give the last level more steps; it is thinnest at ({place}) mm",
    )


def _scallop_json(lens: Lens, inner: FaceCheck, outer: FaceCheck) -> dict[str, Any]:
    """Cusps where the face is most convex: there they are highest and steepest."""
    manufacture = lens.spec.manufacture
    cutter_mm, stepover_mm = manufacture.cutter_radius_mm, manufacture.stepover_mm
    content: dict[str, Any] = {"stepover_mm": stepover_mm, "slope_limit_mrad": manufacture.slope_limit_mrad}
    for face in (inner, outer):
        kappa = max(float(face.samples.curvatures.maximum.max()), -1.0 / cutter_mm)
        height = scallop_height_mm(cutter_mm, stepover_mm, kappa)
        slope = scallop_slope_rad(cutter_mm, stepover_mm, kappa)
        limit = stepover_for_slope_mm(cutter_mm, 1e-3 * manufacture.slope_limit_mrad, kappa)
        content[face.name] = {
            "height_nm": 1e6 * height if np.isfinite(height) else None,
            "slope_mrad": 1e3 * slope if np.isfinite(slope) else None,
            "stepover_for_slope_limit_mm": limit if np.isfinite(limit) else None,
        }
    return content


def _verdicts(
    lens: Lens, inner: FaceCheck, outer: FaceCheck, wall: ThinnestWall, relief: dict[str, Any]
) -> list[ShopVerdict]:
    cutter_mm = lens.spec.manufacture.cutter_radius_mm
    faces = (inner, outer)
    least_deg = {face.name: float(np.degrees(draft_rad(face.samples).min())) for face in faces}
    return [
        *(cutter_verdict(face.name, cutter_mm, face.reachable_fraction, face.largest_cutter_mm) for face in faces),
        *relief_verdicts(relief),
        *(
            tilt_verdict(
                face.name, float(np.degrees(largest_tilt_rad(face.samples))), lens.spec.manufacture.max_tilt_deg
            )
            for face in faces
        ),
        wall_verdict(wall.thickness_mm, lens.spec.constraints.min_thickness_mm),
        *(draft_verdict(face.name, least_deg[face.name], undercut_fraction(face.samples)) for face in faces),
    ]


def _write_maps(path: Path, inner: FaceCheck, outer: FaceCheck) -> None:
    maps = {"chart_axis": inner.samples.grid.axis}
    for face in (inner, outer):
        samples = face.samples
        for key, values in (
            ("xyz", samples.points),
            ("sag_mm", face.sphere.deviation_mm),
            ("kappa_min", samples.curvatures.minimum),
            ("kappa_max", samples.curvatures.maximum),
            ("residual_mm", face.residual_mm),
            ("reachable", face.reached.astype(np.float64)),
        ):
            maps[f"{face.name}_{key}"] = samples.grid.to_map(values)
    with replacing(path) as temporary:
        np.savez_compressed(temporary, **maps)  # type: ignore[arg-type]  # the stub takes a map for a flag
