"""Findings on a linear lens that is extruded: what the wire that cuts its die leaves, and how even its walls are."""

from collections.abc import Iterator, Mapping

from lensforge.cad.part_limits import FIT_TOLERANCE
from lensforge.results import Fact
from lensforge.results.fact import Change
from lensforge.results.numerals import quantity
from lensforge.results.verdict import within
from lensforge.shop.check_measures import FLAT_FOR_TIPS_MM, FaceResult, Walls
from lensforge.shop.findings import BODY, finding_on, rounded_down_mm
from lensforge.spec import Spec
from lensforge.spec.spec_section import rounded_up


def extrusion_findings(spec: Spec, faces: Mapping[str, FaceResult], walls: Walls) -> Iterator[Fact]:
    """Findings on each profile and on the walls of a lens that is extruded; none of any other."""
    shop = spec.manufacture
    if not shop.making.is_drawn:
        return
    for name, face in faces.items():
        yield _wire(name, face, shop.wire_radius_mm)
    if shop.most_wall_ratio is not None:
        yield _even(walls, shop.most_wall_ratio)


def _wire(name: str, face: FaceResult, radius_mm: float) -> Fact:
    """The wire cuts the opening of the die, and leaves its radius where the part is convex, seen from the air."""
    highest = face.curvature.kappa_max_per_mm
    tightest_mm = 1.0 / highest if highest > 1.0 / FLAT_FOR_TIPS_MM else None
    tolerance = 0.0 if tightest_mm is None else FIT_TOLERANCE * tightest_mm
    if tightest_mm is None:
        return finding_on("wire", name, radius_mm, None, f"no place of the {name} profile is convex: any wire cuts it")
    cuts = "cuts" if within(radius_mm, "<=", tightest_mm, tolerance) else "does not cut"
    tightest = quantity(tightest_mm, "mm", digits=4)
    reason = (
        f"a wire of {quantity(radius_mm, 'mm')} radius {cuts} the die of the {name} profile, whose min. convex radius "
        f"is {tightest}"
    )
    smaller = Change("manufacture.wire_radius_mm", rounded_down_mm(tightest_mm))
    return finding_on("wire", name, radius_mm, tightest_mm, reason, [smaller], tolerance)


def _even(walls: Walls, most: float) -> Fact:
    """Walls that cool at different times bend the profile behind the die."""
    thin_mm = walls.thinnest.thickness_mm
    thick_mm = walls.thickest.thickness_mm
    ratio = thick_mm / thin_mm
    reason = (
        f"the walls are from {quantity(thin_mm, 'mm', digits=4)} to {quantity(thick_mm, 'mm', digits=4)}; "
        f"manufacture.most_wall_ratio = {most:g}"
    )
    thicker = "a larger constraints.min_thickness_mm, or a smaller constraints.max_wall_mm, and design again"
    allowed = Change("manufacture.most_wall_ratio", f"{rounded_up(ratio)}", " where the shop can hold that")
    return finding_on("even", BODY, ratio, most, reason, [thicker, allowed])
