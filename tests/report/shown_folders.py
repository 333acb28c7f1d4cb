"""Result folders of every kind, with numbers told apart, for tests of what is shown of them."""

from dataclasses import replace
from math import nan
from pathlib import Path

from addon_rows import addon_rows
from filled import told_apart
from made_yield import make_yield
from part_files import EXTRAS, verified
from result_folders import STAGES, criterion, finding, make_light, make_proof, make_results, small_lens, text_target

from lensforge.cad.part_limits import KeepOutDistance
from lensforge.light.evaluation_result import FittedLight, LightMetrics, PresetError, TableError
from lensforge.light.light_ways import LightWay
from lensforge.light.receiver_light import Flux, MissedByCause
from lensforge.light.region_light import RegionLight
from lensforge.made.tolerance_result import ErrorRow, Sensitivity
from lensforge.report.results import Results
from lensforge.results import Conditions, Fact, Metric
from lensforge.results.criteria import at_most
from lensforge.scene.lens import Lens
from lensforge.shop.findings import check_findings
from lensforge.sources.source_summary import SourceSummary
from lensforge.spec.design_spec import parse_spec
from lensforge.spec.source_sections import RayfileSource
from lensforge.spec.spec_files import changed

WALL = {
    "kind": "plane", "name": "wall", "centre_mm": (100.0, 0.0, 200.0), "width_mm": 300.0, "height_mm": 150.0,
    "targets": ({"kind": "rectangle", "width_mm": 100.0, "height_mm": 60.0, "uniform_mm": 40.0},),
}  # fmt: skip
BEAM = {"kind": "beam", "fwhm_deg": (60.0, 25.0), "uniform_deg": 10.0}
SKY = {"kind": "far_field", "name": "sky", "half_angle_deg": 80.0, "targets": (BEAM,)}
_COATED = {
    "inner": {"coating": {"reflectance": 0.005}, "draft_deg": 2.0},
    "outer": {"coating": {"reflectance": 0.012}, "draft_deg": 3.0},
    "cavity_index": 1.25,
}
REGION = RegionLight(
    region="uniform",
    mean=Metric(value=2.5, unit="W/m²", standard_error=0.01),
    u0=Metric(value=0.81, standard_error=0.02),
    u1=Metric(value=0.7, standard_error=0.03),
    peak=Metric(value=1.13, standard_error=0.006),
)
ROAD = {"use": "area", "lenses": 24}


def lens_of(wanted=None, lumens_per_watt=None, **sections):
    """The small lens with other ``sections`` of its spec, those of the same name joined."""
    lens = small_lens(wanted=wanted, lumens_per_watt=lumens_per_watt)
    content = changed(lens.spec.model_dump(exclude_unset=True), sections)
    return Lens.double(lens.inner, lens.outer, parse_spec(content, "test"), lens.seed, lens.accuracy)


def _folder(stages, lens, more=None, **records):
    """Results of ``stages`` and ``more`` with numbers told apart."""
    made = make_results(stages, lens, **records)
    results = {stem: told_apart(result) for stem, result in {**made.found, **(more or {})}.items()}
    return replace(made, found=results, seconds=123.4)


def _metrics(nmse, efficiency, uniformity=None):
    metrics = (Metric(value=value, standard_error=error) for value, error in (nmse, efficiency))
    even = None if uniformity is None else Metric(value=uniformity[0], standard_error=uniformity[1])
    return LightMetrics(**dict(zip(("nmse", "efficiency"), metrics, strict=True)), uniformity=even, rsd=even)


def make_sensitivity(**changes):
    row = ErrorRow(
        name="decentre in x", amount=20.0, unit="um",
        metrics=_metrics((0.02013, 4e-4), (0.8475, 1e-3), (0.7, 0.01)),
        change=_metrics((1.3e-4, 3.1e-5), (-0.0025, 1.2e-4), (-0.02, 0.003)),
    )  # fmt: skip
    nominal = _metrics((0.02, 4.4e-4), (0.85, 1e-3), (0.72, 0.01))
    content = {"inputs": {}, "nominal": nominal, "rows": (row,), "preset": "standard", "rays": 4096, "seconds": 1.0}
    return Sensitivity(**{**content, **changes})


def every_stage():
    """All stages, all referees, studies, and the measured part."""
    lens = lens_of()
    measured = {stem: make(lens) for stem, make in addon_rows("CORRECTIONS").items()}
    more = {"sensitivity": make_sensitivity(), "yield": make_yield(lens), **measured}
    return _folder((*STAGES, *EXTRAS), lens, more, verify=verified())


def several_receivers():
    """A wall with a region of uniform light, and the far field."""
    lens = lens_of({"receivers": (WALL, SKY)})
    return _folder((*STAGES, "stray"), lens, verify=verified())


def coated():
    """Coated faces, another medium in the cavity, light that it absorbs, and ways of the light."""
    flux = Flux(
        detected=0.45, outside=0.02, missed=0.31, total_reflection=0.01, not_converged=0.05, absorbed=0.04,
        cover_glass=0.03, reflected=0.09,
    )  # fmt: skip
    missed = MissedByCause(
        backward=0.07, outside_cavity=0.06, base=0.08, missed_receiver=0.055, surfaces_intersect=0.045
    )
    shares = {("side", "wall", "exit"): 0.21, ("cap", "exit"): 0.25, ("inner",): 0.013, (): 0.0017}
    ways = tuple(
        LightWay(faces=faces, share=Metric(value=share, standard_error=share / 90.0)) for faces, share in shares.items()
    )
    light = {"flux": flux, "missed_by_cause": missed, "ways": ways}
    return _folder(("design", "evaluate", "export", "check"), lens_of(lens=_COATED), evaluate=light)


def limits_missed():
    """Limits of the spec, one of them missed, and criteria that are not met or could not be measured."""
    named = {"kind": "points", "at_mm": [[0, 0]]}
    limits = [
        {**named, "name": "HV", "unit": "w_per_m2", "at_least": 60.0},
        {**named, "name": "off", "unit": "w_per_m2", "at_most": 90.0},
    ]
    limit_facts = tuple(
        Fact("limit", name, value, "W/m²", 0.5, sense, bound, note="light", place="light").judged(0.5)
        for name, sense, bound, value in (("HV", ">=", 60.0, 41.0), ("off", "<=", 90.0, 71.5))
    )
    unknown = criterion("thinnest wall", nan, 1.0, ">=")
    wall = finding("wall", "body", False, "the thinnest wall is 0.7 mm")
    results = make_results(
        ("design", "evaluate", "export", "check"),
        lens_of(limits=limits),
        export={"criteria": (at_most("form_error", 12.5, 10.0, "nm", "try something else"),)},
        check={"criteria": (unknown,), "verdicts": (wall,)},
        evaluate={"nmse": Metric(value=0.3, standard_error=0.001)},
    )
    light = told_apart(results.light).model_copy(update={"limits": limit_facts})  # bounds are those of the spec
    return replace(results, found={**results.found, "evaluate": light, "design": told_apart(results.design)})


def uniform_region():
    """Lux in a region of uniform light, with the noise of the rays taken off."""
    lens = lens_of({"target": text_target("+", 40.0)}, lumens_per_watt=250.0)
    changes = {
        "uniformity": Metric(value=0.8, standard_error=0.01), "rsd": Metric(value=0.09, standard_error=0.002),
        "raw": {"nmse": 0.0125, "uniformity": 0.6, "rsd": 0.07}, "in_region": REGION,
        "lumens_per_watt": 250.0, "nmse_of_noise": 0.0033,
    }  # fmt: skip
    return _folder(("evaluate",), lens, evaluate=changes)


def ray_file():
    """A ray file as the source, warnings on it, one sample of rays, and the error of the preset's tables."""
    lens = small_lens()
    source = RayfileSource(file=Path("led.tm25ray"))
    lens = replace(lens, spec=lens.spec.model_copy(update={"source": source}))
    left = TableError(
        table_error_nm=1.5, hit_max_mm=0.4, hit_mm=Metric(value=0.015, standard_error=0.001),
        irradiance_nmse=Metric(value=0.00031, standard_error=0.00002), efficiency=Metric(value=-1e-5),
    )  # fmt: skip
    error = PresetError(rays=1024, scrambles=8, design=left, evaluation=left)
    warned = SourceSummary(title="led.tm25ray", flux_w=1.0, symmetry="none", warnings=("2,000 effective rays",))
    alone = {name: Metric(value=value) for name, value in (("nmse", 0.0125), ("efficiency", 0.85))}
    light = {**alone, "share_in_target": Metric(value=0.8), "preset_error": error, "nmse_of_noise": 0.0017}
    fitted = {"nmse": Metric(value=0.00873, standard_error=0.00041), "efficiency": Metric(value=0.8613)}
    light["fitted"] = FittedLight(rays=6543, **fitted)
    return _folder(("design", "evaluate"), lens, design={"source": warned}, evaluate=light)


def moulded():
    """Mould inserts of a coated lens: drafts, limits of size and wall, a keep-out solid, a mass."""
    limits = {"max_wall_mm": 9.0, "max_height_mm": 12.5}
    shop = {"process": "moulded", "shrinkage": 0.0125, "form_tolerance_um": 2.5}
    base = {"diameter_mm": 25.4, "flange_diameter_mm": 30.0, "pocket_diameter_mm": 12.0}
    lens = lens_of(constraints=limits, manufacture=shop, base=base, lens=_COATED)
    keep_out = KeepOutDistance(
        distance_mm=0.35, body_point_mm=(1.0, 2.0, 3.0), keep_out_point_mm=(2.0, 2.0, 3.0), error_mm=0.001
    )
    results = _folder(
        ("design", "export", "check"), lens, export={"keep_out": keep_out, "mass_g": 4.5}, check={"process": "moulded"}
    )
    check = results.check
    findings = check_findings(lens.spec, check.faces, check.min_wall_mm, check.relief, check.tools)
    records = {**results.found, "check": check.model_copy(update={"verdicts": findings})}
    return replace(results, found=records)


def far_field():
    """A lamp for a road, in candela."""
    lens = lens_of({"target": {**BEAM, "half_angle_deg": 80.0}, "photometry": ROAD}, lumens_per_watt=250.0)
    return _folder(("evaluate", "photometry", "verify"), lens, evaluate={"lumens_per_watt": 250.0})


def search_only():
    """A search that has nothing after it."""
    return _folder(("design",), lens_of())


def other_conditions():
    """Results under other than nominal conditions."""
    lens = lens_of()
    other = {"conditions": Conditions.of(rays=64)}
    cold = Conditions.of(source_name="cold", source="ray file cold.ray", rays=64, source_sha256="ab" * 32)
    made = (
        make_light(lens, conditions=cold.model_copy(update={"temperature_c": 55.0})),
        make_proof(lens, **other),
        make_sensitivity(**other),
        make_yield(lens).model_copy(update=other),
        *(make(lens).model_copy(update=other) for make in addon_rows("OF_FACES").values()),
        *(make_results((stem,), lens).found[stem].model_copy(update=other) for stem in ("stray", "photometry")),
    )
    others = {f"{result.stage}_{result.conditions.name}": told_apart(result) for result in made}
    return replace(_folder(("evaluate",), lens), others=others)


FOLDERS = {
    make.__name__.replace("_", " "): make
    for make in (
        every_stage, several_receivers, coated, limits_missed, uniform_region, ray_file, moulded, far_field,
        search_only, other_conditions,
    )
}  # fmt: skip


def folder_of(name) -> Results:
    """The folder ``name`` of ``FOLDERS``."""
    return FOLDERS[name]()
