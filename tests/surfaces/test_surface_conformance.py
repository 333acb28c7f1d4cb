"""What every kind of surface must be; a new kind without a case here fails."""

import json
from copy import deepcopy
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from scenes import hemisphere_directions, random_surface, small_spec
from scenes import sphere as freeform_sphere

from lensforge.cad.form_error import chart_samples, fit_to_form, form_error
from lensforge.errors import InputError
from lensforge.scene.lens import Lens, load_lens
from lensforge.surfaces import surface as chart
from lensforge.surfaces.asphere import Asphere, Biconic, ImplicitSurface, sphere
from lensforge.surfaces.bicubic_table import grid_for, table_error, tabulate
from lensforge.surfaces.chart_spline import HALF_WIDTH, ChartSpline
from lensforge.surfaces.drawn_profile import DrawnFace
from lensforge.surfaces.grooved_face import GroovedFace
from lensforge.surfaces.profile import FormedFace, ProfileFace
from lensforge.surfaces.reciprocal import ConeFace, ConicFace, PlaneFace, ReciprocalSurface
from lensforge.surfaces.surface import ScaledSurface, Surface, scaled

AXIS = np.tan(np.linspace(-1.0, 1.0, 80) * np.arctan(HALF_WIDTH))
ON_AXIS = chart.to_sphere(np.stack(np.meshgrid(AXIS, AXIS, indexing="ij"), axis=-1))
CASES = {
    "freeform": random_surface(1, 6.0, levels=(9, 81)),
    "mirrored freeform": random_surface(2, 6.0, levels=(9, 81), symmetry="square"),
    "centred sphere": sphere(6.0),
    "sphere, undercut at the rim": sphere(6.0, 3.0),
    "sphere below": sphere(6.0, -4.0),
    "prolate dome": Asphere(13.5, -11.0, -0.4, (-2e-5, 1e-8)),
    "hyperbolic dome": Asphere(6.0, -3.0, -2.0),
    "dented dome": Asphere(5.0, 30.0, 0.0, (-4e-3,)),
    "biconic": Biconic(8.0, -7.0, -9.0, -0.5, 0.2),
    "given face": ChartSpline.through(AXIS, random_surface(1, 6.0, levels=(9, 25)).radius_on_grid(ON_AXIS)),
    "plane": PlaneFace(8.0, 6.0, (0.1, -0.05, 1.0)),
    "cone": ConeFace(8.0, 6.0, 0.1),
    "conic": ConicFace(20.0, 6.0, 0.7, (0.1, 0.2, 1.0)),
    "profile": ProfileFace(20.0, -0.3, 1.0, (0.21, 0.2, 0.188, 0.178, 0.17, 0.166, 0.166, 0.168, 0.172)),
    "lens within a ring": GroovedFace.of(
        20.0,
        ProfileFace(20.0, 0.2, 1.0, (0.24, 0.22, 0.2, 0.185, 0.17, 0.16, 0.155)),
        ProfileFace(20.0, 0.1, 0.95, (0.13, 0.14, 0.15, 0.165, 0.18, 0.195, 0.21)),
        4.0,
    ),
    "drawn along y": DrawnFace(12.0, (0.17, 0.165, 0.16, 0.158, 0.155, 0.154, 0.156, 0.16, 0.164, 0.17)),
    "face of an insert": scaled(random_surface(3, 6.0, levels=(9, 25)), 1.006),
}


def test_every_kind_of_surface_has_a_case() -> None:
    known = {*Surface.__subclasses__(), *ImplicitSurface.__subclasses__(), *ReciprocalSurface.__subclasses__()}
    known -= {ImplicitSurface, ReciprocalSurface}
    kinds = {kind for kind in known if kind.__module__.startswith("lensforge.surfaces.")}
    assert {type(surface) for surface in CASES.values()} == kinds


@pytest.fixture(params=CASES, scope="module")
def surface(request: pytest.FixtureRequest) -> Surface:
    return CASES[request.param]


def _everywhere(count: int) -> np.ndarray:
    """Directions down to 28 degrees below the horizon."""
    u = np.concatenate([hemisphere_directions(count), hemisphere_directions(count, 1) * (1.0, 1.0, -0.5)])
    return u / np.linalg.norm(u, axis=1, keepdims=True)


def test_the_gradient_is_the_derivative_along_great_circles(surface: Surface) -> None:
    u = _everywhere(300)
    along = np.cross(u, np.random.default_rng(2).normal(size=u.shape))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    step = 1e-5
    ahead, behind = (surface.radius(np.cos(step) * u + s * np.sin(step) * along) for s in (1, -1))
    assert np.allclose((ahead - behind) / (2 * step), np.sum(surface.gradient(u) * along, axis=1), atol=2e-8)
    assert np.abs(np.sum(surface.gradient(u) * u, axis=1)).max() < 1e-12


def test_normals_are_of_unit_length_outward_and_across_the_surface(surface: Surface) -> None:
    u = hemisphere_directions(300)
    normal = surface.normal(u)
    assert np.allclose(np.linalg.norm(normal, axis=1), 1.0, atol=1e-14)
    assert (np.sum(normal * u, axis=1) > 0.0).all()
    turned = np.stack([u[:, 0] * np.cos(1e-6) - u[:, 1] * np.sin(1e-6), u[:, 0] * np.sin(1e-6) + u[:, 1], u[:, 2]], 1)
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    chord = turned * surface.radius(turned)[:, None] - u * surface.radius(u)[:, None]
    assert np.abs(np.sum(chord * normal, axis=1)).max() < 1e-9  # of 1e-6 rad and some mm


def test_its_table_converges_in_fourth_order_down_to_the_rim(surface: Surface) -> None:
    detail = min(surface.detail_rad, 0.25)
    errors = []
    for nodes in (4.0, 8.0):
        grid = grid_for(detail, nodes)
        errors.append(table_error(grid, tabulate(grid, surface), surface))
    assert errors[1] < max(errors[0] / 10.0, 1e-11)


def test_its_spline_reaches_the_form_of_an_export(surface: Surface) -> None:
    patch = fit_to_form(surface)
    samples = chart_samples(1024, seed=5)
    error = form_error(surface, patch.points(samples), patch.normals(samples))
    assert error.form_max_nm < 1.0 and error.normal_max_mrad < 0.02


@pytest.mark.parametrize("name", [name for name, shape in CASES.items() if not isinstance(shape, ScaledSurface)])
def test_a_lens_file_gives_the_same_surface_back(name: str, tmp_path) -> None:
    """But for the face of an insert, which is written with a factor on the lens's."""
    surface = CASES[name]
    lens = Lens.double(surface, freeform_sphere(20.0), small_spec(), 0, "draft")
    lens.save(tmp_path / "lens.json")
    again = load_lens(tmp_path / "lens.json").inner
    u = _everywhere(100)
    assert type(again) is type(surface)
    assert np.array_equal(again.radius(u), surface.radius(u))
    again_saved = Lens.double(again, freeform_sphere(20.0), small_spec(), 0, "draft")
    again_saved.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == (tmp_path / "lens.json").read_bytes()


def test_a_surface_of_the_same_numbers_is_the_same_key_of_a_cache(surface: Surface) -> None:
    """A body behind the lens, whose tables are kept, may have any of them as a face."""
    again = deepcopy(surface)
    assert again == surface and hash(again) == hash(surface) and {again: 1}[surface] == 1


def test_surfaces_that_differ_in_one_number_of_an_array_are_two_keys() -> None:
    freeform = CASES["freeform"]
    given = CASES["given face"]
    profile = CASES["profile"]
    numbers = vars(profile) | {"srbf": freeform.basis, "weights_per_mm": 1e-4 * freeform.weights_mm}
    formed = FormedFace(**{field.name: numbers[field.name] for field in fields(FormedFace)})
    for surface, name in ((freeform, "weights_mm"), (given, "control"), (formed, "weights_per_mm")):
        changed = getattr(surface, name).copy()
        changed.flat[-1] += 1e-12
        other = replace(surface, **{name: changed})
        assert surface != other and len({surface, other, deepcopy(other)}) == 2
    assert formed != profile and freeform != given


@pytest.mark.parametrize("head", [{"schema": "lensforge-lens-2"}, {"format": "lensforge-lens-1"}])
def test_a_lens_file_of_an_earlier_version_is_refused_in_one_line(head: dict[str, str], tmp_path: Path) -> None:
    lens = Lens.double(CASES["freeform"], freeform_sphere(20.0), small_spec(), 0, "draft")
    content = {key: value for key, value in lens.to_json().items() if key != "schema"}
    (tmp_path / "lens.json").write_text(json.dumps({**head, **content}), encoding="utf-8")
    with pytest.raises(InputError, match=r"must be 'lensforge-lens-3'; run `lensforge design` again$") as refusal:
        load_lens(tmp_path / "lens.json")
    assert "\n" not in str(refusal.value)
