"""Small results for tests: every stage's record with numbers that are easy to recognise."""

from dataclasses import replace
from functools import cache

import numpy as np
import trimesh
from filled import filled
from made_photometry import make_photometry
from undrawn import without_views

from lensforge.cad.face_tolerance import FaceTolerance
from lensforge.cad.mesh import BodyMesh
from lensforge.cad.mesh_files import threemf_bytes
from lensforge.cad.part import STEP_FILE, STL_FILE, THREEMF_FILE, Faces, Part, stamp_of
from lensforge.light.evaluation_result import Light
from lensforge.light.receiver_light import Flux, MissedByCause, Possible, RawMetrics, ReceiverLight
from lensforge.proof.cast_results import Agreement, PlainCast, SizedFile, Sizes
from lensforge.proof.file_form import FileForm
from lensforge.proof.proof_result import IndependentRays, Proof, ReceiverProof
from lensforge.report.lens_page import render_report
from lensforge.report.results import Results
from lensforge.results import BodySize, Extent, Fact, Metric
from lensforge.results.criteria import at_least, at_most
from lensforge.results.estimates import nmse
from lensforge.scene.lens import Lens
from lensforge.scene.receiver_shapes import build_receiver
from lensforge.search.design_result import Design, Level, Margins
from lensforge.shop.check_measures import BallClearance, Curvature, Cutter, Draft, FaceResult, Wall, Walls
from lensforge.shop.check_result import Check
from lensforge.shop.findings import as_finding
from lensforge.sources.source_summary import SourceSummary
from lensforge.spec import parse_spec
from lensforge.surfaces import surface as chart
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

SIZE = BodySize(volume_mm3=3833.5, area_mm2=1250.5, bounds_mm=((-14.0, -14.0, -2.0), (14.0, 14.0, 13.5)))
STAGES = ("design", "evaluate", "export", "check", "verify", "photometry")
PIXELS, NODES = 16, 21


def small_lens(text="+", inner_mm=4.0, outer_mm=10.0, bump_mm=0.3, lumens_per_watt=None, uniform_mm=None, wanted=None):
    """A lens for a text; ``wanted``: instead, the spec's own ``target`` or ``receivers``."""
    basis = SrbfBasis((9,), 1.75)
    weights = bump_mm * np.linspace(-1.0, 1.0, basis.size)
    content = {
        "name": "small",
        "source": {"kind": "square", "side_mm": 2.0, "luminous_efficacy_lm_per_w": lumens_per_watt},
        "lens": {"inner": {"offset_mm": inner_mm}, "outer": {"offset_mm": outer_mm}, "levels": [9]},
        "evaluate": {"pixels": PIXELS},
        "constraints": {
            "cavity_height_mm": 1.0,
            "cavity_radius_mm": 1.5,
            "min_thickness_mm": 1.0,
            "max_radius_mm": max(11.0, 1.1 * outer_mm),
        },
        **(wanted or {"target": text_target(text, uniform_mm)}),
    }
    surfaces = (SrbfSurface(basis, weights, inner_mm), SrbfSurface(basis, weights[::-1].copy(), outer_mm))
    return Lens.double(*surfaces, parse_spec(content, "test"), seed=7, accuracy="draft")


def with_leds(lens, *names):
    """``lens`` for as many LEDs like its own, by their names."""
    leds = [{"name": name, "source": lens.spec.source} for name in names]
    return replace(lens, spec=lens.spec.replace(source=None, sources=leds))


def text_target(text, uniform_mm=None):
    place = {"distance_mm": 150.0, "receiver_mm": 300.0, "uniform_mm": uniform_mm}
    return {"kind": "text", "text": text, "width_mm": 50.0, **place}


def finding(name, surface, holds, reason):
    """A finding that holds or does not; its numbers are of no matter."""
    return as_finding(Fact(name, "", 1.0, "mm", limit=2.0 * holds, note=reason, place=surface))


def criterion(name, value, limit, sense="<="):
    return {"<=": at_most, ">=": at_least}[sense](name, value, limit, "mm", "try something else")


def make_results(stages=STAGES, lens=None, outdated=None, **records):
    """The results of ``stages`` for ``lens``; ``records``: others by their stem, or changes of one as a dict."""
    lens = lens or small_lens()
    results = {}
    for stem in dict.fromkeys((*stages, *records)):
        given = records.get(stem, {})
        results[stem] = MAKERS[stem](lens, **given) if isinstance(given, dict) else given
    for stem in ("verify", "stray", "compare"):
        if stem in results:
            made_from = {name: results[name].sha256 for name in ("export", "evaluate") if name in results}
            inputs = dict.fromkeys(("export", "evaluate"), "0" * 64) | {"lens": lens.sha256} | made_from
            results[stem] = results[stem].model_copy(update={"inputs": inputs})
    return Results(lens, results, outdated or {})


def make_folder(folder, stages=STAGES, lens=None, **records):
    """Write the files of :func:`make_results` into ``folder``; return it."""
    folder.mkdir(parents=True, exist_ok=True)
    results = make_results(stages, lens, **records)
    results.lens.save(folder / "lens.json")
    for stem, result in results.found.items():
        made = result.judgements_on(results.lens)  # a folder with others is refused
        fields = {field: tuple(judgements) for field, judgements in made.items()}
        if isinstance(result, Check | Proof):
            fields = {field: tuple(made) for field, made in result.judgements().items()}
        result.model_copy(update=fields).write(folder, stem)
    return folder


def page_of(results, folder=None):
    """The report without the three-dimensional views, which take a process and seconds."""
    with without_views():
        return render_report(results, folder)


def divided(changes, receiver):
    """``changes`` of the record on the first receiver, of class ``receiver``, and those of the record on all."""
    of_first = {name: value for name, value in changes.items() if name in receiver.model_fields}
    return of_first, {name: value for name, value in changes.items() if name not in of_first}


def evaluate_arrays():
    """The images of the light on the first receiver."""
    return light_images(PIXELS, PIXELS)


def light_images(rows, columns):
    """Images of light with a bright rectangle, a quarter of the rows from below and above."""
    x, y = (((np.arange(count) + 0.5) / count - 0.5) * 300.0 for count in (columns, rows))
    target = np.zeros((rows, columns))
    target[rows // 4 : rows - rows // 4, 5 * columns // 16 : 11 * columns // 16] = 40.0
    ripple = 1.0 + 0.05 * np.sin(y)[:, None] * np.cos(x)
    return {"target_map": target, "map": target * ripple + 0.5, "raw_map": target * ripple**2 + 0.5}


def face_maps():
    """Maps of a face over its chart."""
    nodes = np.linspace(-1.0, 1.0, NODES)
    points = np.stack(np.meshgrid(nodes, nodes, indexing="ij"), axis=-1)
    outside = np.sum(points**2, axis=-1) > 1.0
    values = {
        "sag_mm": 0.1 * points[..., 0],
        "kappa_min": -0.8 + 0.5 * points[..., 1],
        "kappa_max": 0.2 + 0.1 * points[..., 1],
        "residual_mm": np.maximum(0.0, points[..., 0] - 0.5),
    }
    maps = {name: np.where(outside, np.nan, value) for name, value in values.items()}
    return {"xyz": 5.0 * chart.to_sphere(points), **maps}


def make_level(level, functions, **curves):
    """A level of the search; ``curves``: over its steps, margins by their first word."""
    margins = {"cavity": "cavity_clearance_mm", "wall": "wall_margin_mm", "radius": "radius_margin_mm"}
    constraints = {name: curves.pop(word) for word, name in margins.items()}
    return Level(level=level, functions=functions, constraints=constraints, **curves)


HISTORY = (
    make_level(
        0, 9, loss=(1.8, 1.0, 0.6), nmse=(0.9, 0.5, 0.3), efficiency=(0.5, 0.6, 0.7),
        cavity=(2.0, 1.5, 1.25), wall=(3.0, 2.0, 1.0), radius=(0.75, -0.375, -0.0625),
    ),
    make_level(
        1, 34, loss=(0.4, 0.2, 0.1, 0.05), nmse=(0.2, 0.1, 0.05, 0.025), efficiency=(0.75, 0.8, 0.85, 0.875),
        cavity=(1.0, 0.875, 0.625, 0.5), wall=(0.5, 0.375, 0.3125, 0.25), radius=(-0.03125, 0.0, 0.0625, 0.125),
    ),
)  # fmt: skip


def make_design(lens, **changes):
    content = {
        "lens": lens,
        "inputs": {"lens": lens.sha256, "spec": "ef" * 32},
        "steps": 7,
        "constraints": Margins(cavity_clearance_mm=0.5, wall_margin_mm=0.25, radius_margin_mm=0.125),
        "source": SourceSummary(title="2 mm square", flux_w=1.0, symmetry="square"),
        "source_outline_mm": ((-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)),
        "history": HISTORY,
    }
    return filled(Design, **{**content, **changes})


def make_receiver_light(section, rows=PIXELS, columns=PIXELS, **changes):
    """The light on one receiver of a spec."""
    width, height = section.size
    round_window = section.kind in ("far_field", "sphere")
    sides = {"width": None, "height": None, "radius": 0.5 * width}
    if not round_window:
        sides = {"width": 280.0 * width / 300.0, "height": 280.0 * height / 300.0, "radius": None}
    content = {
        "name": section.name,
        "kind": section.kind,
        "place": section.place,
        "width": width,
        "height": height,
        "window": sides,
        "nmse": Metric(value=0.0123, standard_error=0.0004),
        "efficiency": Metric(value=0.85, standard_error=0.0002),
        "share_in_target": Metric(value=0.8125, standard_error=0.0003),
        "possible": filled(Possible, efficiency=0.95, share_in_target=0.95, nmse=0.001, estimate=None),
        "flux": Flux(
            detected=0.85, outside=0.02, missed=0.03, total_reflection=0.01, not_converged=0.0, reflected=0.09
        ),
        "missed_by_cause": MissedByCause(
            backward=0.0, outside_cavity=0.0, base=0.01, missed_receiver=0.02, surfaces_intersect=0.0
        ),
        **light_images(rows, columns),
    }
    content |= changes
    raw = filled(RawMetrics, nmse=nmse(content["map"], content["target_map"]))
    return filled(ReceiverLight, **{"raw": raw, **content})


def make_light(lens, **changes):
    """The light of ``lens``; ``changes``: of the record, or of the light on its first receiver."""
    of_first, of_record = divided(changes, ReceiverLight)
    receivers = []
    for section in lens.spec.all_receivers:
        grid = build_receiver(section, PIXELS).grid
        receivers.append(make_receiver_light(section, *grid.shape, **({} if receivers else of_first)))
    content = {
        "inputs": {"lens": lens.sha256, "source": "ef" * 32},
        "receivers": tuple(receivers),
        "rays": 65536,
        "replicates": 16,
        "pixels": PIXELS,
        "filter": "3x3 Gaussian, variance 1 pixel^2",
        "lumens_per_watt": lens.spec.source.luminous_efficacy_lm_per_w,
        "table_error_nm": {"inner": 0.75, "outer": 1.75},
    }
    return filled(Light, **{**content, **of_record})


def sphere_stl():
    return trimesh.creation.icosphere(subdivisions=2, radius=5.0).export(file_type="stl")


@cache
def sphere_3mf():
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=5.0)
    face = (sphere.triangles_center[:, 2] > 0.0).astype(int)
    return threemf_bytes(BodyMesh(sphere.vertices, sphere.faces, face, ("OPTICAL_INNER", "OPTICAL_OUTER"), 0), "sphere")


def make_part(lens, stl=None, **changes):
    files = {STEP_FILE: b"a STEP", STL_FILE: sphere_stl() if stl is None else stl, THREEMF_FILE: sphere_3mf()}
    content = {
        "lens": lens,
        "inputs": {"lens": lens.sha256},
        "form_error_nm": Extent(max=1.75, rms=0.5),
        "volume_mm3": SIZE.volume_mm3,
        "area_mm2": SIZE.area_mm2,
        "bounds_mm": SIZE.bounds_mm,
        "genus": 0,
        "faces": Faces(count=2, names=("OPTICAL_INNER", "OPTICAL_OUTER")),
        "nodes": {"inner": 33, "outer": 65},
        "signature": {"author": "", "organisation": "", "date": None},
        "files": {name: stamp_of(content) for name, content in files.items()},
        "face_tolerance": FaceTolerance(form_nm=10.0),
        "step_valid": True,
        "step_volume_change": 1e-13,
        "watertight": True,
        "watertight_3mf": True,
        "genus_difference": 0,
        "volume_mesh_mm3": SIZE.volume_mm3,
        "step": files[STEP_FILE],
        "stl": files[STL_FILE],
        "threemf": files[THREEMF_FILE],
    }
    return filled(Part, **{**content, **changes})


def make_check(lens, **changes):
    face = filled(
        FaceResult,
        cutter=Cutter(radius_mm=1.0, reachable_fraction=0.75, largest_radius_mm=0.77, residual_mm=0.5),
        curvature=filled(Curvature, smallest_concave_radius_mm=0.775),
        draft_deg=Draft(min=-3.25),
        **face_maps(),
    )
    content = {
        "lens": lens,
        "inputs": {"lens": lens.sha256},
        "scale": 1.0,
        "inner": face,
        "outer": face,
        "min_wall_mm": 1.875,
        "walls": filled(Walls, thinnest=filled(Wall, thickness_mm=1.875)),
        "relief": BallClearance(faces={}, note="there is no base"),
        "criteria": (criterion("thinnest wall", 1.875, 0.999, ">="),),
        "verdicts": (finding("wall", "body", True, "the wall is thick enough"),),
        "chart_axis": np.linspace(-1.0, 1.0, NODES),
    }
    return filled(Check, **{**content, **changes})


def make_receiver_proof(section, **changes):
    """The rays through the part on one receiver."""
    images = light_images(*build_receiver(section, PIXELS).grid.shape)
    content = {
        "name": section.name,
        "width": section.size[0],
        "height": section.size[1],
        "far_field": section.kind == "far_field",
        "efficiency": 0.8475,
        "against_design": filled(Agreement, rms=0.0125, flux=0.00025, fates_flux=0.000375),
        "nmse_same_rays": 0.000625,
        "nmse_vs_design": 0.0875,
        "deviation_limit_mm": 0.015,
        "own_rays": filled(IndependentRays, nmse_less_noise=Metric(value=0.00035, standard_error=0.0015)),
        "irradiance": images["raw_map"],
        "design_irradiance": images["map"],
        "gaps_mesh_mm": np.linspace(1e-4, 0.1, 501),
    }
    return filled(ReceiverProof, **{**content, **changes})


def make_proof(lens, **changes):
    """The verification of ``lens``; ``changes``: of the record, or of the rays on its first receiver."""
    first, *others = lens.spec.all_receivers
    of_first, of_record = divided(changes, ReceiverProof)
    content = {
        "inputs": {"lens": lens.sha256},
        "receivers": (make_receiver_proof(first, **of_first), *map(make_receiver_proof, others)),
        "open_edges": 0,
        "sizes": Sizes(exported=SIZE, chord_mm=0.000875, mesh=SizedFile(size=SIZE), step=SizedFile(size=SIZE)),
        "emission_apart": 2.25,
        "forms": tuple(
            filled(FileForm, name=name, off_um=0.0075, open_edges=0, lacking=())
            for name in (STEP_FILE, STL_FILE, THREEMF_FILE)
        ),
        "plain_cast": PlainCast(rays=200, casts=390, disagreements=0),
    }
    return filled(Proof, **{**content, **of_record})


MAKERS = {
    "design": make_design,
    "evaluate": make_light,
    "export": make_part,
    "check": make_check,
    "verify": make_proof,
    "photometry": make_photometry,
}
