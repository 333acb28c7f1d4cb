"""Acceptance of an exported part: the limits, and the criteria on its casts, on independent rays, and on its size.

The criteria follow from the results alone, so that the criteria in a file can be held against what the file's own
numbers say. Rays see the optical faces alone. A base that is too thick, a bore that is too wide or a missing flange is
seen by volume, area and box of each file against those of the export.
"""

from collections.abc import Iterator
from itertools import chain

from lensforge.proof.cast_results import Agreement, BrepCast, MitsubaCast, SizedFile, Sizes
from lensforge.proof.remedies import FINER, Evidence, form_of_mesh, form_of_step
from lensforge.results import BodySize, Fact
from lensforge.results.criteria import at_most, declare_labels

_MESH = "mesh (lens.stl)"
_STEP = "STEP file"
_FILES = {"": _MESH, "brep_": _STEP, "mitsuba_": f"{_MESH} in Mitsuba"}  # by the beginning of a criterion's name
_LABELS = {
    "deviation_rms": "ray displacement by the {}",
    "flux_deviation": "flux of each ray through the {}, against the design",
    "fate_disagreement_flux": "flux that ends otherwise through the {}",
    "fate_disagreements": "rays that end otherwise through the {}",
    "nmse_vs_design": "pattern of the {}, against the design",
    "volume_change": "volume of the {}, against the export",
    "area_change": "area of the {}, against the export",
    "box_change": "outer size of the {}, against the export",
}
declare_labels(
    lambda: (
        (f"{prefix}{name}", words.format(file)) for prefix, file in _FILES.items() for name, words in _LABELS.items()
    )
)

# Share of flux: rays that graze the rim or the limit of total reflection may end either way.
FLUX_SHARE = 1e-3
NOISE_ALLOWANCE = 1e-3  # of the NMSE against the design's irradiance


BLOCKS = 16  # of rays, whose pictures tell light from noise
LEAST_RAYS = 4 * BLOCKS  # for a picture of each block
ERRORS = 4.0  # standard errors: of 100,000 right samplers 6 would be taken for a wrong one
# Of 27 means and products of a right sampler one is that many standard errors off in 1 of 975,000 verifications.
MOST_APART = 5.5
_WRONG = "the design's source is sampled wrongly, please report it"
EMITTED_OTHERWISE = f"the design's rays differ in place or direction from the description of the source: {_WRONG}"
OTHER_LIGHT = (
    "rays drawn from the source's description make other light than the design's: evaluate and verify again; if "
    f"it stays where all other criteria are met, {_WRONG}"
)


# Faces that another CAD program has written again may lie so far off: a fifth of the finest tolerance of a drawing. The
# kernel of lensforge itself writes them again within 1e-6 mm.
REWRITTEN_MM = 0.002
# Facets of another program are excused up to this height: cadquery's finest setting (0.001 mm, 0.1 rad) makes 0.03 mm
# on a lens 25 mm wide. A base that is a tenth of a millimetre off is seen whatever the facets are.
MOST_CHORD_MM = 0.05
_SCALED_ALIKE = 0.1  # of the change: what facets make of a part scaled by 1.001, 0.03 of it for an exported mesh
_MOST_AREA = 0.01  # relative: what such facets lack of the area of a lens
_UNITS = {
    1.0 / 25.4: "the file is in inches",
    25.4: "the file is 25.4 times too large, as if its mm were inches",
    0.1: "the file is in cm",
    10.0: "the file is ten times too large, as if its mm were cm",
    0.001: "the file is in metres",
    1000.0: "the file is a thousand times too large, as if its mm were metres",
}
_NEAR_UNIT = 2e-3  # relative: of the ratio of boxes, whose facets may differ
ELSEWHERE = "lens.stl has a face that the design has not, or one of its faces lies elsewhere: export again"
INWARDS = "its facets face inwards (the volume is negative): flip their normals, and write the file again"


def size_criteria(sizes: Sizes | None) -> Iterator[Fact]:
    """Criteria of all files; none if the size as exported is not known."""
    if sizes is None:
        return
    yield from _file_criteria(sizes, sizes.mesh, "", _size_difference(sizes.exported, sizes.mesh, "lens.stl"))
    if sizes.step is not None:
        yield from _file_criteria(sizes, sizes.step, "brep_", _size_difference(sizes.exported, sizes.step, "lens.step"))


def size_mismatch(sizes: Sizes | None, name: str) -> str:
    """Difference in size between the body in the file ``name`` and the export, as a sentence; "" if they agree."""
    file = None if sizes is None else sizes.step if name == "lens.step" else sizes.mesh
    if sizes is None or file is None or all(criterion.holds for criterion in _file_criteria(sizes, file, "", "")):
        return ""
    return _size_difference(sizes.exported, file, name)


def _file_criteria(sizes: Sizes, file: SizedFile, prefix: str, remedy: str) -> Iterator[Fact]:
    exported = sizes.exported
    in_file = file.size
    moved_mm3 = REWRITTEN_MM * exported.area_mm2
    volume = (min(file.facets_mm3, MOST_CHORD_MM * exported.area_mm2) + moved_mm3) / exported.volume_mm3
    # Faces moved by d change volume by A d, and area by the same share at most.
    area = min(file.facets_mm2 / exported.area_mm2, _MOST_AREA) + moved_mm3 / exported.volume_mm3
    box = min(file.chord_mm, MOST_CHORD_MM) + sizes.chord_mm + REWRITTEN_MM
    changes = (
        ("volume_change", in_file.volume_mm3 / exported.volume_mm3 - 1.0, volume, "of the volume"),
        ("area_change", in_file.area_mm2 / exported.area_mm2 - 1.0, area, "of the area"),
        ("box_change", max(map(abs, _box_changes(exported, in_file))), box, "mm"),
    )
    yield from (at_most(f"{prefix}{name}", abs(value), limit, unit, remedy) for name, value, limit, unit in changes)


def _box_changes(exported: BodySize, in_file: BodySize) -> list[float]:
    pairs = zip(chain(*exported.bounds_mm), chain(*in_file.bounds_mm), strict=True)
    return [in_file_mm - exported_mm for exported_mm, in_file_mm in pairs]


def _scale(exported: BodySize, in_file: BodySize) -> float | None:
    """Ratio of all lengths, too small for the light to show; None if volume and area contradict it."""
    exported_sides, file_sides = (
        [high - low for low, high in zip(*size.bounds_mm, strict=True)] for size in (exported, in_file)
    )
    ratios = [side / before if before > 0.0 else 0.0 for before, side in zip(exported_sides, file_sides, strict=True)]
    scale = sum(ratios) / 3.0
    powers = (
        *((ratio, 1) for ratio in ratios),
        (in_file.area_mm2 / exported.area_mm2, 2),
        (in_file.volume_mm3 / exported.volume_mm3, 3),
    )
    alike = all(abs(ratio - scale**power) <= _SCALED_ALIKE * abs(scale**power - 1.0) for ratio, power in powers)
    return scale if alike and scale != 1.0 else None


def _size_difference(exported: BodySize, file: SizedFile, name: str) -> str:
    """Sentence on a scale, or on the volume and the side of the box that differs most."""
    in_file = file.size
    changes = _box_changes(exported, file.size)
    if in_file.volume_mm3 < 0.0:
        return f"{name}: {INWARDS}"
    scale = _scale(exported, in_file)
    if scale is not None:
        unit = next((explanation for ratio, explanation in _UNITS.items() if abs(scale / ratio - 1.0) < _NEAR_UNIT), "")
        difference = unit or f"it is the lens scaled by {scale:.5g}"
        return f"{name}: {difference}: write it again as it was exported, in mm"
    side = max(range(6), key=lambda k: abs(changes[k]))
    stated, seen = (list(chain(*size.bounds_mm))[side] for size in (exported, in_file))
    place = f"{'least' if side < 3 else 'largest'} {'xyz'[side % 3]}"
    return (
        f"{name} is another body than the one exported: volume {in_file.volume_mm3:.5g} mm^3, exported "
        f"{exported.volume_mm3:.5g}; {place} {seen:.5g} mm, exported {stated:.5g}; correct it, or export again"
    )


# Rays may land as far off as if the lens turned them by so much, rms: 0.1 mm for each metre that the light goes, more
# where it arrives at a slope (Screen.reach_mm). A lens a few mm wide that is 1 % too large or has a
# surface displaced by 20 um is at several times that; 200,000 triangles of the roughest lens use a fifth of it.
DEVIATION_RAD = 1e-4
# Behind a face that scatters a hundredth of its spread more: that widens the light by 0.005 %.
OF_SPREAD = 0.01
FATE_SHARE = FLUX_SHARE  # of rays that end otherwise
# With the same rays the irradiance may change by a tenth of what other rays would change, or by 1 % rms of itself.
SAME_RAYS_FLOORS = 0.1
SAME_RAYS_ALLOWANCE = 1e-4
# The difference from the design's irradiance may be noise only: that of both, if the design has no fewer rays.
NOISE_FLOORS = 2.5
FINE_FACETS_UM = 1.0  # rms height of the faces over their facets, 0.34 as exported: such facets land rays right

BREP_RAYS = 1024  # through the STEP file: the CAD kernel casts a few hundred in a second
# Half of the mesh's limit. The B-rep itself lands rays within 0.1 um at 150 mm of the exact surfaces; the
# deviation from the design is that of the design's own table: 4 um at draft accuracy, 2 um at standard.
BREP_DEVIATION_RAD = 5e-5
BREP_FLUX_SHARE = 1e-4
BREP_FATE_RAYS = 2  # of 1024: rays that graze an edge or the limit of total reflection may end either way

# 1 mrad, rms: flat facets of a mesh of 200,000 triangles use 0.2 to 0.4 of it. Smaller
# errors are found by the casts through the curved surface.
MITSUBA_DEVIATION_RAD = 1e-3
MITSUBA_FLUX_SHARE = MITSUBA_FATE_SHARE = 2e-3


def noise_limit(floor: float) -> float:
    """Largest NMSE against the design that noise explains; ``floor``: NMSE by the noise of the part's rays alone."""
    return NOISE_FLOORS * floor + NOISE_ALLOWANCE


def _landing_criteria(prefix: str, evidence: Evidence) -> list[Fact]:
    """Criteria of rays cast through a file: where they land, and their flux."""
    design = evidence.agreement
    return [
        at_most(f"{prefix}deviation_rms", design.rms, evidence.deviation_mm, "mm", evidence.of_deviation()),
        at_most(f"{prefix}flux_deviation", design.flux, evidence.flux, "of the flux", evidence.of_flux()),
    ]


def cast_criteria(prefix: str, evidence: Evidence) -> list[Fact]:
    """Criteria of rays cast through a mesh: where they land, their flux, and the flux of other fates."""
    fates = evidence.agreement.fates_flux
    return [
        *_landing_criteria(prefix, evidence),
        at_most(f"{prefix}fate_disagreement_flux", fates, evidence.fates, "of the flux", evidence.of_fates()),
    ]


def mesh_landing_criteria(agreement: Agreement, limit_mm: float) -> list[Fact]:
    """Criteria of rays cast through a mesh on trial; ``limit_mm``: largest rms displacement."""
    return list(cast_criteria("", Evidence(agreement, limit_mm, FLUX_SHARE, FATE_SHARE, FINER)))


def brep_criteria(cast: BrepCast, reach_mm: float, fault: str = "", same_form: bool = False) -> list[Fact]:
    """Acceptance criteria of a STEP file; ``reach_mm``: of the receiver's light.

    ``fault``: a fault recognised in the file. ``same_form``: its faces are known to agree with the design.
    """
    seen = brep_evidence(cast, reach_mm, fault, same_form)
    allowed = BREP_FATE_RAYS * max(1.0, cast.rays / BREP_RAYS)
    return [
        *_landing_criteria("brep_", seen),
        at_most("brep_fate_disagreements", cast.against_design.fates, allowed, "rays", seen.of_fates()),
    ]


def brep_evidence(cast: BrepCast, reach_mm: float, fault: str = "", same_form: bool = False) -> Evidence:
    """Agreement of the STEP file with the design, and its limits; arguments as in :func:`brep_criteria`."""
    form = form_of_step(same_form)
    limit = BREP_DEVIATION_RAD * reach_mm
    fates = BREP_FATE_RAYS / BREP_RAYS
    return Evidence(cast.against_design, limit, BREP_FLUX_SHARE, fates, form, fault, fine=True)


def mitsuba_criteria(cast: MitsubaCast, reach_mm: float, fault: str = "", *, fine: bool = False) -> list[Fact]:
    """Acceptance criteria of the exported mesh by Mitsuba; ``reach_mm``: of the receiver's light.

    ``fault``: a fault of the mesh; ``fine``: its facets do not cause the differences.
    """
    design = cast.against_design
    floor = noise_limit(cast.noise_floor_nmse)
    limit = MITSUBA_DEVIATION_RAD * reach_mm
    form = form_of_mesh(0, None, fine=fine)
    seen = Evidence(design, limit, MITSUBA_FLUX_SHARE, MITSUBA_FATE_SHARE, form, fault, fine)
    nmse = at_most("mitsuba_nmse_vs_design", cast.nmse_vs_design, floor, "", seen.of_pixels())
    return [nmse, *cast_criteria("mitsuba_", seen)]
