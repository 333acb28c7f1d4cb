"""The handover to the shop, from the results of a lens: drawing, page, PDF and DXF of the same content, and tables.

Facts on the page say what the part is, what defines it, how its faces measure, and what each table holds.
"""

from lensforge.cad.part import Part
from lensforge.scene.lens import Lens
from lensforge.shop.check_result import BallClearance, Check, FaceResult
from lensforge.shop.handover import PointGrid
from lensforge.spec import DrawingSection
from lensforge.spec.spec_section import rounded_up

Facts = dict[str, str]
DEFINITION = (
    "lens.step alone defines the part; its faces OPTICAL_OUTER and OPTICAL_INNER are the optical ones. Drawing, tables "
    "and pictures are for inspection, the dense tables for tool paths within the error that they state. All have the "
    "coordinates of lens.step: z = 0 is the plane in which both optical faces end, z the optical axis."
)


def part_facts(lens: Lens, part: Part, check: Check, words: DrawingSection) -> Facts:
    """Facts on the part and its files; ``words``: those of its drawing."""
    spec, signature = lens.spec, part.signature
    return {
        "Number": words.part_number or "not stated",
        "Revision": words.revision or "not stated",
        "Author": signature.author or "not stated",
        "Organisation": signature.organisation or "not stated",
        "Date": signature.date or "not stated",
        "Material": spec.lens.material,
        "Refractive index": f"{spec.lens.refractive_index:g}",
        **({} if spec.lens.cavity_index == 1.0 else {"Index in the cavity": f"{spec.lens.cavity_index:g}"}),
        **({} if spec.lens.outside_index == 1.0 else {"Index outside": f"{spec.lens.outside_index:g}"}),
        **{
            f"Fixed {name} face": face.title
            for name, face in (("inner", spec.lens.fixed_inner), ("outer", spec.lens.fixed_outer))
            if face is not None
        },
        **_coating_facts(lens),
        "To be manufactured": {"part": "the lens itself", "insert": "mould inserts"}[spec.manufacture.make],
        **_mould_facts(lens, part),
        **_untrimmed_facts(part),
        **_tolerance_facts(lens, part),
        "Volume": f"{part.volume_mm3:.3f} mm³",
        **({} if part.mass_g is None else {"Mass": f"{part.mass_g:.3f} g"}),
        "Form error of the STEP's faces against the design": f"{part.form_error_nm.max:.2g} nm at most",
        "Error of their normals": f"{1e3 * part.normal_error_mrad.max:.2g} µrad at most",
        "STEP schema": part.step_schema,
        "Thinnest wall": f"{check.min_wall_mm:.4f} mm",
        "Thickest wall, along rays from the origin": f"{check.wall.thickest.thickness_mm:.4f} mm",
        "Lens, SHA-256": lens.sha256,
        "lensforge": lens.version,
    }


def _coating_facts(lens: Lens) -> Facts:
    """Coatings of the optical faces; nothing for bare ones."""
    section = lens.spec.lens
    each = (("inner", section.inner_coating), ("outer", section.outer_coating))
    return {f"Coating of the {name} face": coating.title for name, coating in each if coating is not None}


def _mould_facts(lens: Lens, part: Part) -> Facts:
    """Shrinkage, and the files that carry it; nothing for a lens that is cut itself."""
    shop = lens.spec.manufacture
    if shop.make == "part":
        return {}
    mould = "the tables of points, figures and pictures of the optical faces"
    if part.untrimmed_surfaces is not None:
        mould = f"lens_surfaces.step, {mould}"
    return {
        "Shrinkage": f"{shop.shrinkage:.12g}; {mould} are those of the mould: the lens times {shop.scale:.12g} about "
        "the origin; lens.step, lens.stl, lens.3mf, section, dimensions, volume and wall are of the moulded lens"
    }


def _untrimmed_facts(part: Part) -> Facts:
    """Run-out and errors of the untrimmed faces; nothing where they are not exported."""
    found = part.untrimmed_surfaces
    if found is None:
        return {}
    return {
        "Faces of lens_surfaces.step": f"{found.runout_deg:g}° beyond the rim; above it their form errs by "
        f"{found.form_error_nm:.2g} nm at most against the design times {found.scale:.12g}, their normals by "
        f"{1e3 * found.normal_error_mrad:.2g} µrad"
    }


def _tolerance_facts(lens: Lens, part: Part) -> Facts:
    """Form tolerance of the optical faces; nothing where the spec has none."""
    width_um = lens.spec.manufacture.form_tolerance_um
    if width_um is None:
        return {}
    carried = "its schema carries none"
    if part.form_tolerances:
        against = "against A" if part.form_tolerances[0].datum_faces else "without datum, as no face lies in z = 0"
        carried = f"it is on these faces as a surface profile {against}"
    return {
        "Form tolerance of the lens's optical faces": f"{width_um:g} µm, width of the zone, half of it on each side of "
        f"the face; in lens.step {carried}"
    }


def face_facts(name: FaceName, face: FaceResult, relief: BallClearance) -> Facts:
    """Figures of one optical face by the check."""
    sphere, ball = face.best_fit_sphere, face.cutter
    base = relief.beyond_shop(ball.largest_radius_mm, ball.radius_mm, name)
    return {
        "Best-fit sphere, radius": f"{sphere.radius_mm:.4f} mm",
        "Departure from it, peak to valley": f"{1e3 * sphere.pv_mm:.2f} µm",
        "Departure, rms": f"{1e3 * sphere.rms_mm:.2f} µm",
        "Smallest concave radius": _length(face.curvature.smallest_concave_radius_mm),
        "Largest ball that reaches the whole face": f"{_length(ball.largest_radius_mm)}{base}",
        "Largest tilt": f"{face.largest_tilt_deg:.2f}°",
        "Least draft": f"{face.draft_deg.min:.2f}°",
    }


def grid_facts(grid: PointGrid) -> str:
    """Points, spacing and error of a dense table."""
    at = "on the face" if grid.offset_mm == 0.0 else f"{grid.offset_mm:g} mm off the face, into the air"
    return (
        f"{grid.points} points {at}, up to {grid.spacing_mm:.4g} mm apart; {grid.interpolation} interpolation errs by "
        f"at most {rounded_up(grid.error_nm, 3)} nm along the normal"
    )


def _length(value: float | None) -> str:
    return "any" if value is None else f"{value:.4f} mm"
