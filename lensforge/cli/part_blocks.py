"""The part on the screen: its size, its files, and in short whether it can be cut."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from lensforge.cad.part import STEP_FILE, SURFACES_FILE, Part
from lensforge.cli.rounded import count, figure, share
from lensforge.cli.screen import Row
from lensforge.proof.proof_result import Proof
from lensforge.search.design_result import Design
from lensforge.shop.check_result import Check, FaceName
from lensforge.spec import Spec

if TYPE_CHECKING:
    from lensforge.shop.handover import Handover

_ALSO = {"relief": "base in the way", "tilt": "too steep", "tool": "beyond the reach of a tool"}
_SMALL_MM = 0.1  # lengths below it are shown in micrometres


def lens_rows(design: Design, spec: Spec) -> Iterator[Row]:
    """A line on the size of the lens."""
    limits = spec.constraints
    height = "" if limits.max_height_mm is None else f" (at most {limits.max_height_mm:g})"
    yield (
        "Size",
        f"radius {figure(design.max_radius_mm)} mm (at most {limits.max_radius_mm:g}), "
        f"height {figure(design.height_mm)} mm{height}",
    )


def start_rows(design: Design) -> Iterator[Row]:
    """Lines on the searches from several seeds, the kept one first, and how far they scatter."""
    if design.spread is None:
        return
    best, following, *_ = sorted(design.starts, key=lambda start: start.rank)
    scatter = figure(design.spread, digits=2)
    yield "Kept", f"seed {best.seed} of {len(design.starts)} (standard deviation of the merit {scatter})"
    yield "Next", f"seed {following.seed}: {following.words}"


def solid_rows(part: Part) -> Iterator[Row]:
    """Lines on the solid and its errors, by the files as read back."""
    form, normal = part.form_error_nm, part.normal_error_mrad
    yield (
        "Form error",
        f"{figure(form.max, 'nm', 2)} at most, normals {figure(normal.max, 'mrad', 2)} (STEP as read back)",
    )
    mass = "" if part.mass_g is None else f", {figure(part.mass_g, 'g')}"
    mesh = "closed" if part.watertight else "not closed"
    yield "Solid", f"{figure(part.volume_mm3, 'mm³')}{mass}; mesh {mesh}, {count(part.triangulation.triangles)} facets"
    scale = part.lens.spec.manufacture.scale
    if part.untrimmed_surfaces is not None:
        scaled = "" if scale == 1.0 else f" times {scale:.12g} for the mould insert; lens.step is the moulded lens"
        yield "Faces", f"{SURFACES_FILE}: the optical faces{scaled}"
    elif scale != 1.0:
        yield (
            "Insert",
            f"{STEP_FILE} is the moulded lens; `lensforge export --runout DEG` writes the faces times {scale:.12g}",
        )
    if part.keep_out is not None:
        yield "Keep-out", f"{figure(part.keep_out.distance_mm, 'mm')} away"


def proof_rows(proof: Proof) -> Iterator[Row]:
    """Lines on the rays through the exported files, against the same rays through the design."""
    for receiver in proof.receivers:
        on = f" on {receiver.name}" if len(proof.receivers) > 1 else ""
        gap, at = receiver.deviation_mm, ", at 1 m" if receiver.far_field else ""
        yield (
            "Ray by ray",
            f"part and design land {length(gap.rms)} apart{on} (rms), at most {length(gap.max)}{at}",
        )


def length(mm: float) -> str:
    """A length in millimetres, a small one in micrometres; two digits."""
    return figure(1e3 * mm, "µm", 2) if mm < _SMALL_MM else figure(mm, "mm", 2)


def cutting_rows(check: Check) -> Iterator[Row]:
    """A line for each face, the wall, and the subjects on which the check has more to say."""
    yield "Inner face", _reach("inner", check)
    yield "Outer face", _reach("outer", check)
    yield "Thinnest wall", figure(check.min_wall_mm, "mm")
    also = []
    for name, words in _ALSO.items():
        faces = [each.surface for each in check.verdicts if each.name == name and not each.holds]
        also += [f"{words} ({', '.join(dict.fromkeys(faces))})"] if faces else []
    if also:
        yield "Also", "; ".join(also)


def _reach(name: FaceName, check: Check) -> str:
    cutter = (check.inner if name == "inner" else check.outer).cutter
    base = check.relief.beyond_shop(cutter.largest_radius_mm, cutter.radius_mm, name)
    ball = f"a ball of {cutter.radius_mm:g} mm radius reaches"
    if cutter.largest_radius_mm is None:
        return f"{ball} all of it; so does any ball{base}"
    if cutter.largest_radius_mm >= cutter.radius_mm:
        return f"{ball} all of it (at most {figure(cutter.largest_radius_mm, 'mm', 3)}{base})"
    return f"{ball} {share(cutter.reachable_fraction)}, one of {figure(cutter.largest_radius_mm, 'mm', 3)} all"


def handover_rows(made: "Handover") -> list[Row]:
    """The files for the shop, the error of each dense table, and the findings that do not hold."""
    rows = [("Files", ", ".join(made.files)), ("Points", f"{count(made.points)} for a measuring machine")]
    rows += [(grid.file, f"{figure(grid.error_nm, 'nm', 2)} at most between its nodes") for grid in made.grids]
    return [*rows, *(("Refused", finding.reason) for finding in made.refused)]
