"""The search of a linear lens with walls: where it begins, its parameters, and what it refuses."""

from typing import Any

import numpy as np
import pytest
import torch
from walled_lenses import KIND, LIMITS, walled_lens, walled_spec

import lensforge as lf
from lensforge.kernels.fate import Fate
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import TracedBundle
from lensforge.search.drawn_profiles import DrawnParameters
from lensforge.search.start_faces import light_across, start_faces
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import tabulate
from lensforge.surfaces.drawn_collimator import SectionRoom, WantedLight, best_drawn_collimator


def test_the_start_sends_light_of_a_point_where_it_is_wanted() -> None:
    """In the plane y = 0, by the tracer: all but what lies beside a crease, or is turned no farther than totally."""
    spec = walled_spec(source={"kind": "square", "side_mm": 0.01}, lens=KIND | {"profile": 48})
    lens = lf.Lens(start_faces(spec), spec, 0, "draft")
    angles = np.radians(np.linspace(-88.0, 88.0, 353))
    ways = np.column_stack([np.sin(angles), 0.0 * angles, np.cos(angles)])
    traced = TracedBundle.of(*_scene(lens), RayBundle(0.0 * ways, ways, np.ones(len(ways))))
    x, _, z = traced.exits.directions.T
    off = np.abs(np.arctan2(x, z) - light_across(spec).turned(angles))
    assert (traced.exits.fates == Fate.LEFT_LENS).all()
    assert {tuple(met[met >= 0] >> 2) for met in traced.met} == {(0, 3), (1, 2, 3)}
    assert (off < 3e-3).mean() > 0.9 and np.median(off) < 3e-4


def _scene(lens: lf.Lens) -> tuple[np.ndarray, Any]:
    traced = TracedLens.of(lens, 8.0)
    return traced.tables, traced.scene


def test_a_wide_source_needs_a_wide_cavity() -> None:
    """The first-order share falls with the width of the source, and the scan does not get worse by more room."""
    shares = []
    for width_mm, half_mm in ((0.2, 10.0), (1.0, 10.0), (1.0, 20.0)):
        light = WantedLight(lambda angles: 0.0 * angles, width_mm, 0.03)
        shares.append(best_drawn_collimator(1.5, light, SectionRoom(half_mm, 60.0, 0.5, 1.0)).share(light))
    assert shares[1] < shares[2] < shares[0] <= 1.0


@pytest.mark.parametrize("symmetry", ["none", "rectangle"])
def test_faces_come_back_from_their_parameters(symmetry: str) -> None:
    spec = walled_spec(lens=KIND | {"symmetry": symmetry})
    parametrisation = DrawnParameters.of(spec, 2.0)
    weights = torch.from_numpy(0.003 * np.random.default_rng(1).normal(size=(24, 4)))
    offsets = torch.tensor([1.02, 0.98, 1.0, 1.01], dtype=torch.float64)
    surfaces = parametrisation.surfaces(weights, offsets)
    for name, table in zip(surfaces, parametrisation.tables(weights, offsets), strict=True):
        assert np.allclose(tabulate(parametrisation.grid, surfaces[name]), table.numpy(), rtol=1e-10)
        assert (surfaces[name].symmetry == "rectangle") == (symmetry == "rectangle")
    again = parametrisation.surfaces(*parametrisation.parameters_of(lf.Lens(surfaces, spec, 0, "draft")))
    for name, surface in surfaces.items():
        assert np.allclose(surface.coefficients, again[name].coefficients, rtol=0.0, atol=1e-12)


def test_tables_follow_the_parameters() -> None:
    parametrisation = DrawnParameters.of(walled_spec(), 2.0)
    rng = np.random.default_rng(2)
    weights = torch.from_numpy(0.002 * rng.normal(size=(24, 4))).requires_grad_()
    way = torch.from_numpy(rng.normal(size=(24, 4)))
    offsets = torch.ones(4, dtype=torch.float64)
    by = torch.from_numpy(rng.normal(size=parametrisation.tables(weights.detach(), offsets).shape))

    def value(step: float) -> torch.Tensor:
        return (by * parametrisation.tables(weights + step * way, offsets)).sum()

    (gradient,) = torch.autograd.grad(value(0.0), weights)
    with torch.no_grad():
        change = (value(1e-6) - value(-1e-6)).item() / 2e-6
    assert (gradient * way).sum().item() == pytest.approx(change, rel=1e-6)


def test_a_record_keeps_profiles_that_others_hide(tmp_path) -> None:
    lens = walled_lens()
    lens.save(tmp_path / "lens.json")
    assert lf.load_lens(tmp_path / "lens.json") == lens
    assert min(lens.surfaces["exit"].coefficients) < 0.0


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"lens": KIND | {"wall": {"offset_mm": 6.0}}}, "wall.offset_mm: the faces of such a lens are found together"),
        ({"lens": KIND | {"exit": {"fixed": {"kind": "sphere", "radius_mm": 9.0}}}}, "exit.fixed: a given surface"),
        ({"lens": KIND | {"profile": 12}}, "lens.profile"),
        ({"lens": KIND | {"levels": [9]}}, "lens.levels"),
        ({"lens": KIND | {"symmetry": "square"}}, "a linear lens has no diagonal"),
        ({"base": {"diameter_mm": 30.0}}, "base: does not go with lens.kind = 'extruded_tir'"),
    ],
)
def test_it_is_refused_in_a_line(changes: dict[str, Any], line: str) -> None:
    with pytest.raises(lf.InputError) as refused:
        walled_spec(**changes)
    assert line in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("limits", "line"),
    [
        ({"max_radius_mm": 2.4, "min_thickness_mm": 0.8}, "mm of wall at the base"),
        ({"max_height_mm": 4.0}, "mm high, at most"),
    ],
)
def test_sizes_without_room_are_refused_in_a_line(limits: dict[str, float], line: str) -> None:
    with pytest.raises(lf.InputError, match=r"^lens: .*\(lens\.kind = 'extruded_tir'\)") as refused:
        start_faces(walled_spec(constraints=LIMITS | limits))
    assert line in str(refused.value) and "\n" not in str(refused.value)
