"""A search for a thin lens whose exit is a lens within a ring: tables, derivatives, files, and a few steps."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch
from presets import FEW
from tir_lenses import SPOT

import lensforge as lf
from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.search.merit import MeritFunction
from lensforge.search.profiles import ProfileParameters
from lensforge.search.start_faces import start_faces
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec, parse_spec
from lensforge.surfaces.bicubic_table import evaluate_table, tabulate
from lensforge.surfaces.grooved_face import Groove, GroovedFace
from lensforge.surfaces.srbf import fibonacci_hemisphere

EXIT = 3


@cache
def thin(profile: int = 12) -> Spec:
    """A lens 6 mm high, of a light of 20 degrees."""
    lens = {"kind": "tir", "profile": profile, "exit": {"groove_radius_mm": 0.3}}
    limits = {"max_radius_mm": 10.0, "max_height_mm": 6.0, "min_thickness_mm": 0.5}
    return parse_spec({**SPOT, "lens": lens, "constraints": limits}, "thin")


@cache
def begun() -> ProfileParameters:
    return ProfileParameters.of(thin(), 2.5)


def moved(size: float) -> tuple[torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(5)
    weights, offsets = begun().start()
    return weights + size * torch.from_numpy(rng.normal(size=weights.shape)), offsets + size


def test_tables_are_those_of_the_faces_in_the_record() -> None:
    parameters = begun()
    weights, offsets = moved(0.002)
    table = parameters.tables(weights, offsets)[EXIT].numpy()
    face = parameters.surfaces(weights, offsets)["exit"]
    assert isinstance(face, GroovedFace)
    off = evaluate_table(parameters.grid, table - tabulate(parameters.grid, face), fibonacci_hemisphere(2000))
    assert np.abs(off).max() < 1e-9
    lens = parameters.lens(weights, offsets, thin(), 0, "draft")
    again = parameters.tables(*parameters.parameters_of(lens))
    assert np.allclose(again[EXIT].numpy(), table, rtol=0.0, atol=1e-6)


def test_the_start_has_the_groove_that_is_asked_for_below_its_height() -> None:
    faces = start_faces(thin())
    face = faces["exit"]
    assert isinstance(face, GroovedFace)
    groove = Groove.of(face.lens, face.ring)
    assert groove is not None
    polar = np.linspace(0.0, np.arccos(groove.cosine) + 0.3, 4001)
    directions = np.column_stack([np.sin(polar), 0.0 * polar, np.cos(polar)])
    rho = face.radius(directions)
    inside = rho < faces["wall"].radius(directions)  # beyond the rim the exit is no face of the lens
    r, z = rho[inside] * np.sin(polar[inside]), rho[inside] * np.cos(polar[inside])
    assert z.max() == pytest.approx(6.0 - 2.0 * thin().constraints.margin_mm, abs=1e-3), "room for the margin"
    rise = np.gradient(np.arctan2(np.gradient(z), np.gradient(r))) / np.hypot(np.gradient(r), np.gradient(z))
    assert 1.0 / rise.max() == pytest.approx(0.3, rel=0.15)


def test_the_derivative_of_the_merit_is_that_of_light_at_the_groove_too() -> None:
    """As the lens tilts the groove moves across light of the LED's edges."""
    spec, parameters = thin(), begun()
    source = build_source(spec.source, None)
    merit = MeritFunction.of(spec, source, parameters)
    rays = source.sample(2**16, 3)
    weights, offsets = parameters.start()
    along = torch.zeros_like(weights)
    along[:6, EXIT] = torch.linspace(-1.0, 1.0, 6, dtype=torch.float64)

    def loss(moved: torch.Tensor) -> torch.Tensor:
        light = merit.light_of(parameters.tables(moved, offsets), rays)
        return merit.terms[0].loss(light.images[0], False)

    step = 1e-3
    difference = (loss(weights + step * along) - loss(weights - step * along)).item() / (2.0 * step)
    moving = weights.clone().requires_grad_()
    loss(moving).backward()
    assert float((moving.grad * along).sum()) == pytest.approx(difference, rel=0.005)


def test_tables_have_the_derivatives_of_both_zones_and_of_the_offset_of_the_face() -> None:
    weights, offsets = moved(0.002)
    by_table = torch.from_numpy(np.random.default_rng(3).normal(size=(begun().grid.side,) * 2))

    def summed(weights: torch.Tensor, offsets: torch.Tensor) -> torch.Tensor:
        return (by_table * begun().tables(weights, offsets)[EXIT]).sum()

    with_gradients = [values.clone().requires_grad_() for values in (weights, offsets)]
    summed(*with_gradients).backward()
    step = 1e-6
    for row in (4, 5, 9, 10):
        along = torch.zeros_like(weights)
        along[row, EXIT] = step
        difference = (summed(weights + along, offsets) - summed(weights - along, offsets)).item() / (2.0 * step)
        assert difference == pytest.approx(float(with_gradients[0].grad[row, EXIT]), rel=1e-5)
    along = step * torch.eye(4, dtype=torch.float64)[EXIT]
    difference = (summed(weights, offsets + along) - summed(weights, offsets - along)).item() / (2.0 * step)
    assert difference == pytest.approx(float(with_gradients[1].grad[EXIT]), rel=1e-5)


def test_a_few_steps_gain_light_and_its_file_gives_it_back(tmp_path: Path) -> None:
    spec = thin().replace(optimise={"steps_per_level": [12], "rays": 4096})
    start = lf.evaluate(begun().lens(*begun().start(), spec, 0, FEW), rays=2**14)
    design = lf.design(spec, accuracy=FEW)
    light = lf.evaluate(design.lens, rays=2**14)
    assert light.limits[0].value > start.limits[0].value + 0.002
    assert design.constraints.height_margin_mm > -spec.constraints.tolerance_mm
    design.lens.save(tmp_path / "lens.json")
    assert lf.load_lens(tmp_path / "lens.json") == design.lens


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"lens.profile": 11},
            r"profile = 11: lens and ring of an exit with a groove share them by halves; at least 12",
        ),
        ({"lens.levels": [9]}, r"groove_radius_mm: a groove is of revolution; leave levels out"),
        ({"lens.cap.offset_mm": 3.0}, r"groove_radius_mm: .* leave offset_mm out"),
        ({"lens.exit.flat": True}, r"groove_radius_mm: such an exit is shaped by the search; leave flat and fixed out"),
        ({"lens.flange": {"diameter_mm": 24.0, "thickness_mm": 1.0}}, r"groove_radius_mm: a flange has no room yet"),
    ],
)
def test_what_a_groove_cannot_be_with_is_refused_in_one_line(changes: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        thin().replace(changes)


def test_a_groove_needs_a_height_and_room_in_it() -> None:
    with pytest.raises(InputError, match=r"a lens with a groove is as high as constraints\.max_height_mm; give it"):
        start_faces(thin().replace({"constraints.max_height_mm": None}))
    with pytest.raises(InputError, match=r"leaves no room for cap, lens and ring"):
        start_faces(thin().replace({"constraints.max_height_mm": 2.0}))


def test_a_groove_that_is_too_fine_for_tables_is_refused_with_the_field_to_raise() -> None:
    too_fine = thin().replace({"lens.exit.groove_radius_mm": 1e-5})
    with pytest.raises(InputError, match=r"narrowest function has .*; take a larger lens\.exit\.groove_radius_mm$"):
        lf.design(too_fine, accuracy=FEW)


def test_a_search_for_a_groove_starts_from_no_smooth_lens() -> None:
    faces = start_faces(thin())
    assert isinstance(faces["exit"], GroovedFace)
    smooth = Lens({**faces, "exit": faces["exit"].ring}, thin(), 0, FEW)
    with pytest.raises(
        InputError, match=r"lens\.start: its exit has no groove; leave lens\.exit\.groove_radius_mm out"
    ):
        begun().parameters_of(smooth)
