"""A search aims through given bodies: the merit's slope by differences, and bounds of what is possible."""

import numpy as np
import pytest
import torch

from lensforge.optics.exit_space import ExitBall
from lensforge.optics.fundamental_limits import transmittance_of
from lensforge.scene.possible_light import PossibleLight, SourceLight
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.search.light_path import SearchParts
from lensforge.search.merit import MeritFunction
from lensforge.search.parameters import SphereParameters
from lensforge.search.scene_symmetry import settled_symmetry
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec, parse_spec

COVER = {
    "name": "cover", "refractive_index": 1.586, "absorption_per_mm": 0.01, "centre_mm": [1.0, 3.0, -2.0],
    "tilt_deg": [14.0, -6.0], "inner": {"fixed": {"kind": "sphere", "radius_mm": 12.0}},
    "outer": {"fixed": {"kind": "asphere", "vertex_z_mm": 16.5, "radius_mm": -15.0, "conic_constant": 0.2}},
}  # fmt: skip


def spec_with(**more) -> Spec:
    content = {
        "source": {"kind": "square", "side_mm": 1.0},
        "lens": {"levels": [9], "inner": {"offset_mm": 3.0}, "outer": {"offset_mm": 6.0}},
        "constraints": {"max_radius_mm": 7.0},
        "target": {"kind": "rectangle", "width_mm": 200.0, "height_mm": 160.0, "distance_mm": 100.0,
                   "receiver_mm": 400.0, "edge_mm": 30.0},
        "optimise": {"pixels": 16},
        "bodies": [COVER],
    }  # fmt: skip
    return parse_spec(content | more, "test")


SCENES = {
    "alone": {},
    "robust": {"optimise": {"pixels": 16, "robust": True}},
    "lamps": {"lamps": {"kind": "table", "places_mm": [[0.0, 0.0], [45.0, 10.0]], "turns_deg": [0.0, 70.0]}},
    "behind a cover glass": {"lens__cover_glass": {"refractive_index": 1.5, "thickness_mm": 4.0, "distance_mm": 20.0}},
}


@pytest.mark.parametrize("scene", SCENES)
def test_the_slope_of_the_merit_by_a_weight_is_that_of_differences(scene: str) -> None:
    """Of the lens with its body alone; of a pair of parts of it; of lamps, each with a body; and behind a glass."""
    changes = dict(SCENES[scene])
    glass = changes.pop("lens__cover_glass", None)
    lens = {"levels": [9], "inner": {"offset_mm": 3.0}, "outer": {"offset_mm": 6.0}}
    spec = spec_with(**changes, lens=lens | ({} if glass is None else {"cover_glass": glass}))
    source = build_source(spec.source)
    spec = settled_symmetry(spec, source)
    assert spec.lens.symmetry == "none"
    parametrisation = SphereParameters.of(spec, 4.0)
    merit = MeritFunction.of(spec, source, parametrisation)
    rays = source.sample(2**12, 3)
    pairs = SearchParts.of(spec, parametrisation).of_step(0, 3) if spec.optimise.robust else ()

    def loss(weights: torch.Tensor) -> torch.Tensor:
        tables = parametrisation.tables(weights, torch.ones(2, dtype=torch.float64))
        return merit.training_loss(merit.light_of(tables, rays, pairs), uniform=False).loss

    some = torch.tensor(np.random.default_rng(1).normal(size=(9, 2)) * 0.02).requires_grad_()
    loss(some).backward()
    for row, column in ((0, 1), (4, 0), (7, 1)):
        changes = []
        for step in (1e-6, -1e-6):
            moved = some.detach().clone()
            moved[row, column] += step
            changes.append(float(loss(moved)))
        slope = (changes[0] - changes[1]) / 2e-6
        assert float(some.grad[row, column]) == pytest.approx(slope, rel=1e-6, abs=1e-8)


def test_bounds_allow_for_the_size_of_the_bodies_and_for_what_they_turn() -> None:
    spec = spec_with()
    alone = spec_with(bodies=[])
    light, bare = (SourceLight.of(build_source(spec.source), scene.media) for scene in (spec, alone))
    (receiver,) = receivers_of(spec, 16)
    with_it, without = (PossibleLight(source, receiver, ExitBall(7.0)) for source in (light, bare))
    assert (with_it.on_pixels >= without.on_pixels).all() and with_it.on_pixels.sum() > 1.5 * without.on_pixels.sum()
    assert with_it.in_region(receiver.window.pixels(receiver.grid)).by_refraction >= 0.9


def test_the_most_that_the_lens_transmits_is_less_by_both_faces_of_a_body() -> None:
    of_faces = (1.0 - (0.586 / 2.586) ** 2) ** 2
    share = transmittance_of(spec_with().media) / transmittance_of(spec_with(bodies=[]).media)
    assert share == pytest.approx(of_faces, rel=1e-12)
