"""A spec made of objects: the same lines of error as the command line, and it reads back equal from its file."""

import datetime
import tomllib
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from scenes import small_spec

import lensforge as lf
from lensforge.errors import InputError
from lensforge.results.registered_kinds import models_in
from lensforge.spec import parse_spec, source_sections
from lensforge.spec.emitter_section import (
    CosineIntensity,
    EmitterSection,
    FileSpectrum,
    GaussianSpectrum,
    IntensitySpec,
    LineSpectrum,
    PhotometricIntensity,
    SpectrumSpec,
    TableIntensity,
    TableSpectrum,
)
from lensforge.spec.fixed_surface import (
    FixedAsphere,
    FixedBiconic,
    FixedCadFace,
    FixedFocalConic,
    FixedLensFace,
    FixedPoints,
    FixedSphere,
    FixedSurface,
    GivenSurface,
)
from lensforge.spec.spec_section import Section
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.surface import surface_record


def test_arrays_come_back_to_the_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    rows = np.column_stack([rng.normal(size=(50, 3)), np.abs(rng.normal(size=(50, 3))), rng.random(50)])
    values = rng.random((7, 9))
    target = lf.ArrayTarget(values, width_mm=90.0, distance_mm=100.0, receiver_mm=200.0)
    spec = small_spec().replace(source=lf.RaySource(rows, flux_w=2.0), target=target)
    spec.save(tmp_path / "small.toml")
    again = lf.load_spec(tmp_path / "small.toml")
    assert again == spec
    assert isinstance(again.source, lf.RaySource) and isinstance(again.target, lf.ArrayTarget)
    assert np.array_equal(again.source.positions_mm, rows[:, :3])
    assert np.array_equal(again.target.values, values)
    assert spec != spec.replace(target={"values": values + 1e-15})
    with pytest.raises(ValueError, match="read-only"):
        again.target.values[0, 0] = 1.0


def test_a_change_keeps_what_was_given_and_no_more() -> None:
    spec = small_spec(lens__material="PC")
    assert spec.replace(lens={"material": "PMMA"}).lens.refractive_index == pytest.approx(1.4914, abs=2e-3)
    assert spec.replace({"constraints.max_radius_mm": 8.0}).constraints.max_radius_mm == 8.0
    assert spec.constraints.max_radius_mm == 7.0
    assert spec.replace(source=lf.DiscSource(diameter_mm=2.0)).source == lf.DiscSource(diameter_mm=2.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"target.distance_mm": "far"}, "target.distance_mm = 'far'"),
        ({"constraints.max_radius_mm": -1.0}, "constraints.max_radius_mm = -1.0"),
        ({"targets": {"distance_mm": 1.0}}, "targets"),
        ({"target.distance_mm": 5.0}, "inside the lens"),
        ({"source": 3}, "source = 3"),
    ],
)
def test_a_change_that_cannot_be_is_one_line(change: dict[str, object], message: str) -> None:
    with pytest.raises(lf.InputError) as refusal:
        small_spec().replace(change)
    assert message in str(refusal.value) and len(str(refusal.value).splitlines()) == 1


def test_a_spec_does_not_change() -> None:
    spec = small_spec()
    for name in ("name", "foo"):
        with pytest.raises(lf.InputError, match=f"^Spec.{name}: a spec does not change; make another with replace"):
            setattr(spec, name, "other")
        with pytest.raises(lf.InputError, match=f"^Spec.{name}: a spec does not change; make another with replace"):
            delattr(spec, name)
    assert spec == small_spec()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.zeros((3, 3)), "not 0 everywhere"),
        (-np.eye(3), "must be 0 or above"),
        ([[1.0, np.nan]], "not finite"),
        ([1.0, 2.0], "shape (2,), must be (n, n)"),
        ("picture.png", "not an array of numbers"),
        ([["1", "2"]], "not an array of numbers"),
        (np.eye(3) + 1e-9j, "not an array of numbers (of type complex128"),
        (np.eye(3) > 0.0, "not an array of numbers (of type bool"),
        ([[1.0], [2.0, 3.0]], "not an array of numbers"),
        (object(), "not an array of numbers (of type object"),
        ({"shape": [2, 2], "float64": "AAAA"}, "not an array of numbers"),
    ],
)
def test_an_array_that_is_no_light_is_one_line(values: object, message: str) -> None:
    with pytest.raises(lf.InputError) as refusal:
        lf.ArrayTarget(values, width_mm=1.0, distance_mm=2.0, receiver_mm=3.0)  # type: ignore[arg-type]
    assert message in str(refusal.value) and len(str(refusal.value).splitlines()) == 1


ROWS = np.column_stack([np.zeros((4, 3)), np.ones((4, 4))])


@pytest.mark.parametrize(
    ("rays", "more", "message"),
    [
        (object(), {}, "RaySource: rays: not an array of numbers (of type object"),
        (None, {}, "RaySource: rays: not an array of numbers"),
        (ROWS[:, :5], {}, "shape (4, 5), must be (n, 7)"),
        (ROWS, {"positions_mm": ROWS[:, :3]}, "positions_mm: rays of 7 columns hold it already"),
        (ROWS, {"directions": ROWS[:, 3:6]}, "directions: rays of 7 columns hold it already"),
        (ROWS, {"ray_flux": ROWS[:, 6]}, "ray_flux: rays of 7 columns hold it already"),
        (ROWS, {"rays": ROWS}, "rays is given twice"),
    ],
)
def test_rays_that_are_none_or_given_twice_are_one_line(rays: object, more: dict[str, object], message: str) -> None:
    with pytest.raises(lf.InputError) as refusal:
        lf.RaySource(rays, **more)  # type: ignore[arg-type]
    assert message in str(refusal.value) and len(str(refusal.value).splitlines()) == 1


SPECTRA = (
    LineSpectrum(wavelength_nm=550.0),
    TableSpectrum(wavelength_nm=(500.0, 600.0), weight=(1.0, 2.0)),
    FileSpectrum(file="led.txt"),
    GaussianSpectrum(peak_nm=450.0, fwhm_nm=20.0),
)
INTENSITIES = (
    CosineIntensity(power=2.0),
    TableIntensity(gamma_deg=(0.0, 60.0), intensity=(1.0, 0.5)),
    PhotometricIntensity(file="led.ies"),
)
SOURCES = (
    source_sections.SquareSource(side_mm=1.0),
    source_sections.RayfileSource(file="led.ray"),
    source_sections.RayfilesSource(
        files=(source_sections.RayfilePart(file="blue.ray"), source_sections.RayfilePart(file="yellow.ray"))
    ),
    source_sections.RectangleSource(width_mm=1.0, height_mm=2.0),
    source_sections.DiscSource(diameter_mm=1.0),
    source_sections.ChipsSource(chips=(source_sections.Chip(x_mm=0.0, y_mm=0.5, width_mm=1.0, height_mm=1.0),)),
    source_sections.ChipArraySource(columns=2, rows=2, width_mm=1.0, height_mm=1.0, pitch_mm=(1.2, 1.2)),
    source_sections.LuminanceSource(file="led.png", width_mm=1.0),
    source_sections.RadianceSource(file="led.npz"),
    source_sections.RaySource(ROWS),
)
INNER = (
    FixedSphere(radius_mm=3.0),
    FixedAsphere(vertex_z_mm=3.0, radius_mm=-3.0),
    FixedBiconic(vertex_z_mm=3.0, radius_x_mm=-3.0, radius_y_mm=-3.1, conic_y=-0.1),
    FixedFocalConic(vertex_mm=2.0, second_focus_mm=0.5),
    GivenSurface(origin="a mould", face=surface_record(sphere(3.0))),
)
OUTER = (FixedSphere(radius_mm=6.0), FixedAsphere(vertex_z_mm=6.0, radius_mm=-6.0, coefficients=(1e-6,)))
OF_FILES = {FixedLensFace, FixedCadFace, FixedPoints}  # which become a given surface
RECTANGLE = {"width_mm": 1.0, "height_mm": 2.0}
SECTIONS: list[dict[str, Section]] = [
    *({"source": source} for source in SOURCES),
    *({"source": source_sections.RectangleSource(intensity=intensity, **RECTANGLE)} for intensity in INTENSITIES),
    *({"source": source_sections.RectangleSource(spectrum=spectrum, **RECTANGLE)} for spectrum in SPECTRA),
    *(
        {
            "source": source_sections.RayfilesSource(
                files=(source_sections.RayfilePart(file="a.ray", spectrum=spectrum),)
            )
        }
        for spectrum in SPECTRA
    ),
    *({"lens": lf.LensSection(levels=(9, 25), inner={"fixed": face}, outer={"offset_mm": 6.0})} for face in INNER),
    *({"lens": lf.LensSection(levels=(9, 25), inner={"offset_mm": 3.0}, outer={"fixed": face})} for face in OUTER),
]


@pytest.mark.parametrize(
    ("union", "made"),
    [(SpectrumSpec, SPECTRA), (IntensitySpec, INTENSITIES), (EmitterSection, SOURCES), (FixedSurface, INNER)],
)
def test_the_sections_below_are_of_every_kind(union: object, made: tuple[Section, ...]) -> None:
    assert {type(section) for section in made} == set(models_in(union)) - OF_FILES


@pytest.mark.parametrize("sections", SECTIONS, ids=lambda sections: repr(*sections.values())[:60])
def test_a_kind_left_to_its_class_is_kept_by_replace_and_save(sections: dict[str, Section], tmp_path: Path) -> None:
    small = small_spec()
    parts = {name: getattr(small, name) for name in type(small).model_fields}
    spec = lf.Spec(**(parts | sections))  # made of objects: no kind was written
    changed = spec.replace(name="x")
    assert changed.name == "x" and changed.replace(name=spec.name) == spec
    for number, written in enumerate((spec, changed)):
        written.save(tmp_path / f"{number}.toml")
        text = (tmp_path / f"{number}.toml").read_text(encoding="utf-8")
        assert parse_spec(tomllib.loads(text), "again", tmp_path) == written  # load_spec wants the files that it names


def test_a_spec_with_automatic_levels_keeps_all_that_does_not_go_with_given_ones() -> None:
    spec = small_spec(target__uniform_mm=60.0)
    automatic = spec.with_automatic_levels()
    assert automatic.lens.levels == "auto"
    assert automatic.optimise.model_dump(exclude_unset=True) == {"pixels": 16}
    assert automatic.target == spec.target and automatic.constraints == spec.constraints


@pytest.mark.parametrize(
    ("fields", "line"),
    [
        ({"date": "31.3.2026"}, r"date = '31\.3\.2026': a date is written as year-month-day"),
        ({"date": "2026-02-30"}, r"date = '2026-02-30': a date is written as year-month-day"),
        ({"date": 20260331}, r"date = 20260331: a date is written as year-month-day"),
        ({"date": datetime.datetime(2026, 3, 31, 12, 0)}, r"date = .*: a date is written as year-month-day"),
        ({"author": "two\nlines"}, r"author = .*cannot be printed"),
    ],
)
def test_a_wrong_field_of_the_shop_is_one_line(fields: dict[str, object], line: str) -> None:
    with pytest.raises(lf.InputError, match=line) as caught:
        lf.ManufactureSection(**fields)
    assert "\n" not in str(caught.value)


def test_a_date_of_toml_and_its_text_are_the_same(tmp_path: Path) -> None:
    dated = small_spec().replace({"manufacture": {"date": "2026-03-31", "author": "A. Author"}})
    dated.save(tmp_path / "text.toml")
    text = (tmp_path / "text.toml").read_text(encoding="utf-8")
    assert 'date = "2026-03-31"' in text
    (tmp_path / "date.toml").write_text(text.replace('"2026-03-31"', "2026-03-31"), encoding="utf-8")
    assert lf.load_spec(tmp_path / "date.toml") == lf.load_spec(tmp_path / "text.toml") == dated
    assert dated.manufacture.date == "2026-03-31"


def test_a_changed_section_or_record_takes_no_value_that_its_field_does_not_allow() -> None:
    spec = small_spec()
    wider = spec.changed(lens=spec.lens.changed(levels=[9, 25]), name="wider")
    assert (wider.lens.levels, wider.name, spec.name) == ((9, 25), "wider", small_spec().name)
    assert wider.model_fields_set == spec.model_fields_set | {"name"}
    for section, change in (
        (spec.lens, {"levels": "many"}),
        (spec, {"lens": 3}),
        (spec.lens.outer, {"offset_mm": -1.0}),
    ):
        with pytest.raises(InputError, match=next(iter(change))):
            section.changed(**change)
    metric = lf.Metric(value=1.0, unit="W", standard_error=0.5)
    assert metric.changed(value=2) == lf.Metric(value=2.0, unit="W", standard_error=0.5)
    for wrong in ({"value": "2"}, {"value": np.inf}, {"standard_error": -0.1}):
        with pytest.raises(ValidationError, match=next(iter(wrong))):
            metric.changed(**wrong)
    with pytest.raises(TypeError, match="Metric has no field error"):
        metric.changed(error=1.0)


def test_a_lens_by_itself_says_that_a_spec_derives_its_sizes_and_a_search_its_levels() -> None:
    with pytest.raises(InputError, match=r"lens\.inner: without a height on the axis"):
        _ = lf.LensSection().start_mm
    with pytest.raises(InputError, match='levels = "auto"'):
        _ = lf.LensSection().basis
