"""Agreement of ``check.json`` with the shop of the spec, the maps of the faces, and the wall of the lens itself."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from lensforge.agreement.comparing import beyond, differing, judged, unlike
from lensforge.lens import Lens
from lensforge.manufacturing.findings import check_findings, wall_criteria
from lensforge.manufacturing.result import Check, FaceName, FaceResult, ToolResult, Wall
from lensforge.surfaces.srbf import fibonacci_hemisphere

_DIRECTIONS = 2000
_SAMPLED = 1e-3  # of the wall: the check samples the faces at other points
_SPEC, _MAPS = "the spec has", "its maps"


def check_contradictions(check: Check, lens: Lens) -> Iterator[str]:
    """Contradictions of the record of a manufacturing check."""
    spec, walls = lens.spec, check.wall
    yield from _shop(check, lens)
    yield from differing("min_wall_mm", check.min_wall_mm, walls.thinnest.thickness_mm, "its walls")
    yield from judged("criteria", check.criteria, wall_criteria(spec, walls))
    derived = check_findings(spec, check.inner, check.outer, check.min_wall_mm, check.relief, check.tools)
    yield from judged("verdicts", check.verdicts, derived)
    for wall in (walls.thinnest, walls.thickest):
        yield from _wall(wall)
    yield from _thinnest(check, lens)
    yield from _face("inner", check.inner, check.inner_sag_mm, check.inner_kappa_max, check.inner_residual_mm)
    yield from _face("outer", check.outer, check.outer_sag_mm, check.outer_kappa_max, check.outer_residual_mm)
    yield from _reach("inner", check.inner, check.inner_reachable)
    yield from _reach("outer", check.outer, check.outer_reachable)


def _shop(check: Check, lens: Lens) -> Iterator[str]:
    """Settings of the spec, which the record repeats."""
    shop = lens.spec.manufacture
    yield from unlike("make", check.make, shop.make, _SPEC)
    yield from unlike("scale", check.scale, shop.scale, _SPEC)
    for name, face in (("inner", check.inner), ("outer", check.outer)):
        yield from unlike(f"{name}.cutter.radius_mm", face.cutter.radius_mm, shop.cutter_radius_mm, _SPEC)
    yield from unlike("scallop.stepover_mm", check.scallop.stepover_mm, shop.stepover_mm, _SPEC)
    yield from differing(
        "scallop.slope_limit_mrad", check.scallop.slope_limit_mrad, shop.slope_limit_mrad, "the spec's limits"
    )
    yield from unlike("tools", [_sizes(tool) for tool in check.tools], [_sizes(tool) for tool in shop.tools], _SPEC)
    below = lens.spec.base if shop.make == "part" else None  # a mould insert has no base
    if below is not None and below.kind != "none" and check.relief.outer is None:
        yield "relief.outer: missing, but the spec has a base"


def _sizes(tool: ToolResult | object) -> tuple[object, ...]:
    names = ("name", "radius_mm", "shank_radius_mm", "length_mm", "holder_half_angle_deg")
    return tuple(getattr(tool, name) for name in names)


def _wall(wall: Wall) -> Iterator[str]:
    across = float(np.linalg.norm(np.subtract(wall.outer_point_mm, wall.inner_point_mm)))
    yield from differing("wall.thickness_mm", abs(wall.thickness_mm), across, "its points")


def _thinnest(check: Check, lens: Lens) -> Iterator[str]:
    """No ray from the origin has less wall than the thinnest, which is between any two points, nor more than stated."""
    u = fibonacci_hemisphere(_DIRECTIONS)
    wall, walls, source = lens.outer.radius(u) - lens.inner.radius(u), check.wall, "the surfaces of lens.json"
    least, most = float(wall.min()), float(wall.max())
    yield from beyond("wall.thinnest", walls.thinnest.thickness_mm, -np.inf, least + _SAMPLED * abs(least), source)
    yield from beyond("wall.thickest", walls.thickest.thickness_mm, most - _SAMPLED * abs(most), np.inf, source)


def _face(
    name: FaceName,
    face: FaceResult,
    sag_mm: Float[np.ndarray, "c c"],
    kappa_max: Float[np.ndarray, "c c"],
    residual_mm: Float[np.ndarray, "c c"],
) -> Iterator[str]:
    """Figures of a face that its maps hold, and figures that follow from one another.

    The face is measured at its rim, too, where a map has no pixel: a largest value may be larger than that of the map.
    """
    curvature, cutter = face.curvature, face.cutter
    if not all(np.isfinite(each).any() for each in (sag_mm, kappa_max, residual_mm)):
        yield f"{name}: its maps are empty"
        return
    departure = float(np.nanmax(sag_mm) - np.nanmin(sag_mm))
    for field, stated, least in (
        ("best_fit_sphere.pv_mm", face.best_fit_sphere.pv_mm, departure),
        ("curvature.kappa_max_per_mm", curvature.kappa_max_per_mm, float(np.nanmax(kappa_max))),
        ("cutter.residual_mm", cutter.residual_mm, float(np.nanmax(residual_mm))),
    ):
        if stated is not None:
            yield from beyond(f"{name}.{field}", stated, least, np.inf, _MAPS)
    lowest = curvature.kappa_min_per_mm
    concave = -1.0 / lowest if lowest < 0.0 else None
    yield from differing(
        f"{name}.curvature.smallest_concave_radius_mm", curvature.smallest_concave_radius_mm, concave, "its curvatures"
    )
    if concave is not None:
        largest = np.inf if cutter.largest_radius_mm is None else cutter.largest_radius_mm
        yield from beyond(f"{name}.cutter.largest_radius_mm", largest, 0.0, concave, "its curvatures")
    half, two = face.draft_deg.area_fraction_below_half, face.draft_deg.area_fraction_below_two
    yield from beyond(f"{name}.draft_deg.area_fraction_below_half", half, 0.0, two, "its drafts")
    if face.draft_deg.min >= 2.0 and two > 0.0:
        yield f"{name}.draft_deg.min = {face.draft_deg.min:.6g}, but {100.0 * two:.3g} % of the area is below 2 deg"


def _reach(name: FaceName, face: FaceResult, reachable: Float[np.ndarray, "c c"]) -> Iterator[str]:
    """A face that is said to be reached as a whole has a map that is 1 everywhere."""
    whole = bool((reachable[np.isfinite(reachable)] == 1.0).all())
    if face.cutter.reachable_fraction >= 1.0 - 1e-9 and not whole:
        yield f"{name}.cutter.reachable_fraction = {face.cutter.reachable_fraction:.6g}, not so in its map"
