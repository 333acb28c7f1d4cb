"""Findings on faces that are turned, and on those of a print: one statement for the shop on each measurement."""

from collections.abc import Iterator, Mapping
from math import sqrt

from lensforge.cad.part_limits import ANGLE_TOLERANCE_DEG, FIT_TOLERANCE
from lensforge.results import Fact
from lensforge.results.fact import Change
from lensforge.results.numerals import percent, quantity
from lensforge.results.verdict import within
from lensforge.shop.check_measures import FaceResult, TurningTool
from lensforge.shop.findings import SHARE_TOLERANCE, design_again, finding_on, rounded_down_mm
from lensforge.spec import Spec

_SLIMMER = "included_angle_deg", "shank_width_mm", "nose_radius_mm"  # fields of a tool that has more room
MOST_CORNER = 0.05  # share of a face that fillets may take


def turning_findings(spec: Spec, faces: Mapping[str, FaceResult]) -> Iterator[Fact]:
    """Findings on each face that is turned: its form, its concave parts, its slopes, and what the tool reaches."""
    for name, face in faces.items():
        if spec.cutting(name) != "turned":
            continue
        if not isinstance(face.cutter, TurningTool):
            yield _of_no_revolution(name, spec)
            continue
        yield _nose(name, face.cutter, spec)
        yield _slope(name, face.cutter, spec)
        yield _reach(name, face.cutter, spec)
        if face.cutter.corner_fraction > 0.0:
            yield _corner(name, face.cutter)


def _of_no_revolution(name: str, spec: Spec) -> Fact:
    """A face that is not of revolution; remedies: a mill, or a search without functions beyond the profiles."""
    reason = f"the {name} face is not of revolution: no turning tool makes it"
    rounder = "lens.levels = [] and design again" if spec.lens.may_be_round and spec.lens.levels else ""
    changes = ['manufacture.process = "milled"', rounder]
    return finding_on("nose", name, None, spec.manufacture.nose_radius_mm, reason, changes)


def _nose(name: str, tool: TurningTool, spec: Spec) -> Fact:
    radius_mm = tool.radius_mm
    largest_mm = tool.largest_radius_mm
    nose = quantity(radius_mm, "mm")
    tolerance = 0.0 if largest_mm is None else FIT_TOLERANCE * largest_mm
    if largest_mm is None:
        reason = f"the meridian of the {name} face has no concave part: a nose of any radius fits"
    else:
        fits = "fits" if within(radius_mm, "<=", largest_mm, tolerance) else "does not fit"
        tightest = quantity(largest_mm, "mm", digits=4)
        reason = (
            f"a nose of {nose} radius {fits} the meridian of the {name} face, whose min. concave radius is {tightest}"
        )
    redesign = design_again("concave_radius_mm", radius_mm, spec, name) if spec.manufacture.cuts == "lens" else None
    smaller = None if largest_mm is None else Change("manufacture.nose_radius_mm", rounded_down_mm(largest_mm))
    return finding_on("nose", name, radius_mm, largest_mm, reason, [redesign, smaller], tolerance)


def _slope(name: str, tool: TurningTool, spec: Spec) -> Fact:
    """Slopes of the face against the flanks of the tool, whose tilt is the same for all of the face."""
    shop = spec.manufacture
    most_deg = shop.steepest_deg
    narrowest = 2.0 * (90.0 - tool.slope_deg - shop.clearance_deg)
    changes = [Change("manufacture.included_angle_deg", str(int(narrowest))) if narrowest >= 1.0 else None]
    holds = within(tool.slope_deg, "<=", most_deg, ANGLE_TOLERANCE_DEG)
    reason = (
        f"at its best tilt a tool follows slopes of up to {quantity(tool.slope_deg, 'deg', digits=4)} on the {name} "
        f"face; flanks {quantity(shop.included_angle_deg, 'deg')} apart allow {'' if holds else 'no more than '}"
        f"{quantity(most_deg, 'deg', digits=4)}, {quantity(shop.clearance_deg, 'deg')} clear of the face"
    )
    return finding_on("slope", name, tool.slope_deg, most_deg, reason, changes, ANGLE_TOLERANCE_DEG)


def _reach(name: str, tool: TurningTool, spec: Spec) -> Fact:
    """Reach of the whole tool, apart from fillets in corners; if it is incomplete, what is in its way."""
    reached, bare = (min(share + tool.corner_fraction, 1.0) for share in (tool.reachable_fraction, tool.bare_fraction))
    shop = spec.manufacture
    tilted = f"tilted by {quantity(abs(tool.tilt_deg), 'deg', digits=3)}"
    changes = []
    if within(reached, ">=", 1.0, SHARE_TOLERANCE):
        but = " but its corners" if tool.corner_fraction > 0.0 else ""
        reason = f"{tilted}, the tool reaches the whole {name} face{but}"
    else:
        reason = f"{tilted}, the tool reaches {percent(reached)} of the {name} face"
        if bare > reached:
            reason += f"; {percent(bare)} without base and flange"
            changes.append('base.kind = "none"')
        if not within(bare, ">=", 1.0, SHARE_TOLERANCE):
            reason += "; elsewhere its flanks or its shank meet the work"
            changes += [f"manufacture.{field} below {getattr(shop, field):g}" for field in _SLIMMER]
    return finding_on("turning", name, reached, 1.0, reason, changes, SHARE_TOLERANCE)


def _corner(name: str, tool: TurningTool) -> Fact:
    """The fillets that the nose leaves where the face meets another in a concave corner."""
    share = tool.corner_fraction
    radius_mm = tool.radius_mm
    left = "" if tool.residual_mm is None else f", up to {quantity(tool.residual_mm, 'mm', digits=2)} high"
    reason = (
        f"a nose of {quantity(radius_mm, 'mm')} radius leaves a fillet on {percent(share)} of the {name} face{left}, "
        "where it meets another in a concave corner"
    )
    smaller = rounded_down_mm(radius_mm * _of_width(MOST_CORNER) / _of_width(share)) if share > 0.0 else "0"
    changes = [Change("manufacture.nose_radius_mm", smaller) if float(smaller) > 0.0 else "a smaller nose"]
    return finding_on("corner", name, share, MOST_CORNER, reason, changes)


def _of_width(share: float) -> float:
    """Radial width of a ring at the edge of a disc with a ``share`` of its area, over the disc's radius.

    No face has a narrower one; a fillet is as wide as the radius of the nose.
    """
    return 1.0 - sqrt(1.0 - share)


def layer_findings(spec: Spec, faces: Mapping[str, FaceResult]) -> Iterator[Fact]:
    """Step height between the layers of a print against half of the form zone, if the spec has both."""
    width_um = spec.manufacture.form_tolerance_um
    layer_um = spec.manufacture.layer_um
    if width_um is None or layer_um is None:
        return
    for name, face in faces.items():
        step_um = face.layer_step_um
        most = f"half of manufacture.form_tolerance_um = {width_um:g}"
        reason = f"layers of {layer_um:g} µm make steps of up to {step_um or 0.0:.4g} µm on the {name} face; {most}"
        fits = "" if not step_um else f"manufacture.layer_um below {0.5 * width_um / step_um * layer_um:.3g}"
        yield finding_on("layer", name, step_um, 0.5 * width_um, reason, [fits, "polish the print"])
