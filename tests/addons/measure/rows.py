"""Rows of the measured part in tables of the suite."""

import shutil
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_records import make_correction, make_inference, make_photo, make_surface
from PIL import Image
from scenes import hemisphere_directions, small_spec, sphere
from test_measured_page import same_where_known

import lensforge as lf
from lensforge.addons.measure.measure_stages import COMPARE, CORRECT, INFER

LENS = lf.Lens.double(sphere(3.0), sphere(6.0), small_spec(), 0, "draft")


def measure_part(run: lf.Run, folder: Path) -> None:
    """Compare with a photograph of the simulated light itself, and with points of the design's own inner surface."""
    light = run.light.map
    seen = np.kron(light[::-1] / light.max(), np.ones((8, 8)))  # 8 pixels of the camera for each, row 0 on top
    photo = folder.with_name("on.png")
    cloud = folder.with_name("cloud.csv")
    Image.fromarray(np.round(60000 * np.pad(seen, 10)).astype(np.uint16)).save(photo)
    low, high = 9.5, 9.5 + 8 * len(light)
    COMPARE.run(folder, on=photo, off=None, corners=[(low, low), (high, low), (high, high), (low, high)])
    u = hemisphere_directions(2000)
    np.savetxt(cloud, u * run.lens.inner.radius(u)[:, None], delimiter=",")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", lf.FileWarning)  # which asks whether these are the design's own points
        COMPARE.run(folder, points=cloud, surface="inner")
        CORRECT.run(folder, points=cloud, surface="inner", wavelength_mm=1.5)
    poses = folder.with_name("poses.csv")
    poses.write_text("0,0,0\n0,0,0\n", encoding="utf-8")
    corners = [(low, low), (high, low), (high, high), (low, high)]
    moved = Path(shutil.copy(photo, photo.with_name("moved.png")))
    INFER.run(folder, pictures=[photo, moved], poses=poses, corners=corners, rays=2**12, pixels=32)


WHOLE_RUN = {"measure": measure_part}  # stages of a run that has all results
MAKERS = {
    "compare": make_photo,
    "compare_outer": make_surface,
    "infer": make_inference,
}  # of records that are easy to recognise, by stem
CORRECTIONS = {"correct_inner": make_correction}
OF_FACES = {"compare_outer": make_surface, "correct_inner": make_correction}
SEEDS = {  # of random images on a page
    "compare": {"simulated": 9, "measured": 10},
    "compare_outer": {"irradiance_design": 11, "irradiance_measured": 12},
}
BROKEN = {  # a wrong entry of a record, and what to run
    "compare": ({"ssim": "high"}, "run `lensforge compare --on`"),
    "compare_outer": ({"point_count": -3}, "run `lensforge compare --points"),
}
FACTS = {  # by key: label, unit, number of the record
    "ssim": ("Similarity (SSIM)", "", lambda r: r.found["compare"].ssim),
    "clipped": ("Saturated pixels", "%", lambda r: 100.0 * r.found["compare"].clipped),
    "form": ("Form deviation", "µm", lambda r: r.found["compare_outer"].form_deviation_um.pv),
    "residual": ("Residual of the points", "µm", lambda r: r.found["compare_outer"].residual_rms_um),
    "first_cut": ("Deviation, first cut", "µm", lambda r: r.found["correct_inner"].deviation_um.rms),
    "second_cut": ("Expected, second cut", "µm", lambda r: r.found["correct_inner"].expected_um.rms),
}


def _pixels(drawn: Any, stem: str, value: Any, lumens_per_watt: float = 1.0) -> None:
    assert drawn.pixels == pytest.approx(lumens_per_watt * value(drawn.of.found[stem]))


def _photo(value: Any) -> Any:
    return lambda drawn: _pixels(drawn, "compare", value)


def _surface(value: Any) -> Any:
    return lambda drawn: _pixels(drawn, "compare_outer", value, drawn.of.light.lumens_per_watt)


PICTURES = {  # of a page, by name: readers, which require that they show what the records hold
    "photo-simulated": _photo(lambda photo: photo.simulated),
    "photo-measured": _photo(lambda photo: photo.measured),
    "photo-difference": _photo(lambda photo: photo.measured - photo.simulated),
    "lit-outer": _surface(lambda surface: surface.irradiance_measured),
    "changed-outer": _surface(lambda surface: surface.irradiance_measured - surface.irradiance_design),
    "form-outer": lambda drawn: same_where_known(drawn.pixels, drawn.of.found["compare_outer"].deviation_um),
}


def compare_points(folder: Path) -> tuple[object, ...]:
    """Arguments of a comparison with points of the design's own outer surface."""
    directions = hemisphere_directions(800)
    points = lf.load(folder).design.lens.outer.radius(directions)[:, None] * directions
    np.savetxt(folder / "points.csv", points, delimiter=",")
    return ("compare", "--surface", "outer", "--points", folder / "points.csv")


EXIT_CODES = {compare_points: 0}
ARGUMENTS = {
    "compare": ("{folder}",),
    "correct": ("{folder}", "--points", "p.csv", "--surface", "inner"),
    "infer": ("{folder}", "--pictures", "a.png", "--poses", "poses.csv"),
}
HEARD: dict[str, dict[str, tuple[str, str, Any]]] = {  # arguments, keyword, its value
    "compare": {
        "--on": ("on.png", "on", Path("on.png")), "--off": ("off.png", "off", Path("off.png")),
        "--corners": ("1,2 3,4 5.5,6 7,8", "corners", [(1.0, 2.0), (3.0, 4.0), (5.5, 6.0), (7.0, 8.0)]),
        "--target-mm": ("12.5", "target_mm", 12.5), "--gamma": ("2.2", "gamma", 2.2),
        "--led": ("second", "led", "second"),
        "--points": ("p.csv", "points", Path("p.csv")), "--surface": ("outer", "surface", "outer"),
        "--registration": ("shift", "registration", "shift"), "--rays": ("1.5e3", "rays", 1500),
    },
    "correct": {
        "--rays": ("1.5e3", "rays", 1500), "--threads": ("3", "threads", 3),
        "--points": ("q.csv", "points", Path("q.csv")), "--surface": ("outer", "surface", "outer"),
        "--inferred": ("infer.json", "inferred", Path("infer.json")),
        "--wavelength": ("1.5", "wavelength_mm", 1.5), "--gain": ("0.7", "gain", 0.7),
        "--registration": ("none", "registration", "none"),
    },
    "infer": {
        "--rays": ("1.5e3", "rays", 1500), "--threads": ("3", "threads", 3), "--pixels": ("48", "pixels", 48),
        "--pictures": ("b.png", "pictures", (Path("a.png"), Path("b.png"))),
        "--poses": ("led.csv", "poses", Path("led.csv")), "--off": ("off.png", "off", Path("off.png")),
        "--corners": ("1,2 3,4 5.5,6 7,8", "corners", [(1.0, 2.0), (3.0, 4.0), (5.5, 6.0), (7.0, 8.0)]),
        "--gamma": ("2.2", "gamma", 2.2), "--expected": ("3.5", "expected_um", 3.5),
    },
}  # fmt: skip
LOCKED = {  # stages that write into a folder, and a file that they would read
    "photo": lambda folder, file: COMPARE.run(folder, on=file, off=None, corners=None),
    "points": lambda folder, file: COMPARE.run(folder, points=file, surface="inner"),
}
REFUSED = {  # by the verbs, and the words
    lambda: lf.compare(LENS, points=5, surface="inner"): "points = 5: give the path",
    lambda: lf.compare("a", on="b"): "compare: give one of two",
    lambda: lf.infer(LENS, pictures=["a.png"], poses="poses.csv"): "pictures: 1 given, must be 2 to 64",
    lambda: lf.infer(
        LENS, pictures=["a.png", "b.png"], poses="poses.csv", expected_um=0.0
    ): "expected_um = 0.0: must be",
}
RESULTS = {kind.__name__: kind for kind in (lf.PhotoComparison, lf.SurfaceComparison, lf.Correction, lf.Inference)}
FORGED = dict.fromkeys(
    (  # record, place of a figure, and what a forger writes there
        ("compare", "clipped", 0.5),
        ("compare", "criteria.0.limit", 0.75),
        ("compare", "criteria.0.passed", None),
        ("compare_inner", "criteria.1.limit", 0.25),
        ("compare_inner", "criteria.0.passed", None),
        ("compare_inner", "used_share", 0.25),
    )
)
JUDGED = {  # by criterion: its place in the record, its sense and its limit
    "photo_clipped": ("clipped", "<=", 0.01),
    "inferred_residual": ("chi_square", "<=", 2.0),
    "correct inferred_residual": ("inferred.chi_square", "<=", 2.0),
    "inferred_errors": ("over_expected", "<=", 4.0),
    "points_used": ("used_share", ">=", 0.9),
    "surface_covered": ("covered_share", ">=", 0.8),
    "concave_radius": ("cutter.concave_radius_mm", ">=", None),
    "correct form_error": ("form_error_nm.max", "<=", 1.0),
    "correct normal_error": ("normal_error_mrad.max", "<=", 0.02),
}


def _optical_face(lens: lf.Lens) -> str:
    return next(face.name for face in lens.body.faces if face.is_optical)


VERBS = {  # of a lens, with points measured on it in the folder
    "compare": lambda lens, folder: lf.compare(lens, points=folder / "points.csv", surface=_optical_face(lens)),
    "correct": lambda lens, folder: lf.correct(
        lens, points=folder / "points.csv", surface=_optical_face(lens), registration="none"
    ),
    "infer": lambda lens, folder: lf.infer(lens, pictures=["on.png", "moved.png"], poses=folder / "poses.csv"),
}
