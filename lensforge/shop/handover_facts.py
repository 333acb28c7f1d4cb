"""Facts of the handover: what the part is, what defines it, how its faces measure, and what each table holds."""

from collections.abc import Iterator

from lensforge.cad.part import SURFACES_FILE, Part, part_facts
from lensforge.results import Fact, Group
from lensforge.results.numerals import quantity, with_unit
from lensforge.scene.lens import Lens
from lensforge.shop.check_facts import check_facts
from lensforge.shop.check_result import Check
from lensforge.shop.handover import PointGrid
from lensforge.spec import DrawingSection
from lensforge.spec.spec_section import rounded_up

_NONE = "not stated"
DEFINITION = (
    "lens.step alone defines the part; its faces OPTICAL_OUTER and OPTICAL_INNER are the optical ones. Drawing, tables "
    "and pictures are for inspection, the dense tables for tool paths within the error that they state. All have the "
    "coordinates of lens.step: z = 0 is the plane in which both optical faces end, z the optical axis."
)


def shop_facts(lens: Lens, part: Part, check: Check, words: DrawingSection) -> Group:
    """Facts on the part and its files; ``words``: those of its drawing."""
    files = part_facts(part)[0].select("form_error", "normal_error", "volume", "mass", "schema", "surfaces").facts
    walls = next(group for group in check_facts(check, lens.spec) if group.key == "wall").facts
    facts = (
        *_title(part, words),
        *_material(lens),
        *_make(lens, part),
        *_tolerance(lens, part),
        *files,
        *walls,
        *_made_by(lens),
    )
    return Group("shop", "Part", facts)


def face_groups(lens: Lens, check: Check) -> list[Group]:
    """Facts of the outer and of the inner face."""
    named = {group.key: group for group in check_facts(check, lens.spec)}
    return [named["outer"], named["inner"]]


def table_facts(grids: tuple[PointGrid, ...]) -> Group:
    """Facts on the dense tables of points."""
    return Group("tables", "Dense tables of points", tuple(map(_grid, grids)))


def _title(part: Part, words: DrawingSection) -> Iterator[Fact]:
    signature = part.signature
    yield Fact("number", "Number", words.part_number or _NONE)
    yield Fact("revision", "Revision", words.revision or _NONE)
    yield Fact("author", "Author", signature.author or _NONE)
    yield Fact("organisation", "Organisation", signature.organisation or _NONE)
    yield Fact("date", "Date", signature.date or _NONE)


def _material(lens: Lens) -> Iterator[Fact]:
    section = lens.spec.lens
    yield Fact("material", "Material", section.material)
    yield Fact("index", "Refractive index", section.refractive_index, digits=6)
    for label, index in (("Index in the cavity", section.cavity_index), ("Index outside", section.outside_index)):
        if index != 1.0:
            yield Fact("other_index", label, index, digits=6)
    for name, face in (("inner", section.fixed_inner), ("outer", section.fixed_outer)):
        if face is not None:
            yield Fact("fixed", f"Fixed {name} face", face.title)
    for name, coating in (("inner", section.inner_coating), ("outer", section.outer_coating)):
        if coating is not None:
            yield Fact("coating", f"Coating of the {name} face", coating.title)


def _make(lens: Lens, part: Part) -> Iterator[Fact]:
    """Object that is cut; of a mould insert the shrinkage, and the files that carry it."""
    shop = lens.spec.manufacture
    made = {"part": "the lens itself", "insert": "mould inserts"}[shop.make]
    yield Fact("make", "To be manufactured", made)
    if shop.make == "insert":
        scale = quantity(shop.scale, digits=12)
        mould = "the tables of points, figures and pictures of the optical faces"
        if part.untrimmed_surfaces is not None:
            mould = f"{SURFACES_FILE}, {mould}"
        note = (
            f"{mould} are those of the mould: the lens times {scale} about the origin; lens.step, lens.stl, lens.3mf, "
            "section, dimensions, volume and wall are of the moulded lens"
        )
        yield Fact("shrinkage", "Shrinkage", shop.shrinkage, note=note, digits=12)


def _tolerance(lens: Lens, part: Part) -> Iterator[Fact]:
    """Form tolerance of the optical faces; nothing where the spec has none."""
    width_um = lens.spec.manufacture.form_tolerance_um
    if width_um is None:
        return
    carried = "its schema carries none"
    if part.form_tolerances:
        against = "against A" if part.form_tolerances[0].datum_faces else "without datum, as no face lies in z = 0"
        carried = f"it is on these faces as a surface profile {against}"
    note = f"width of the zone, half of it on each side of the face; in lens.step {carried}"
    yield Fact("form_tolerance", "Form tolerance of the lens’s optical faces", width_um, "µm", note=note)


def _made_by(lens: Lens) -> Iterator[Fact]:
    yield Fact("sha256", "Lens, SHA-256", lens.sha256)
    yield Fact("lensforge", "lensforge", lens.version)


def _grid(grid: PointGrid) -> Fact:
    """Points, spacing and error of a dense table."""
    spacing, error = quantity(grid.spacing_mm, "mm", digits=4), with_unit(rounded_up(grid.error_nm, 3), "nm")
    note = (
        f"{_at(grid.offset_mm)}, up to {spacing} apart; {grid.interpolation} interpolation errs by at most {error} "
        "along the normal; each node has its normal from the material into the air"
    )
    return Fact("grid", grid.file, grid.points, "points", note=note)


def _at(offset_mm: float) -> str:
    return "on the face" if offset_mm == 0.0 else f"{quantity(offset_mm, 'mm')} off the face, into the air"
