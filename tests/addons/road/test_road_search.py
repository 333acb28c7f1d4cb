"""Roads in a search: the most that lumens can do, and rays that see what a class asks for."""

from pathlib import Path

import numpy as np
import pytest
from known_refraction import normal_transmittance
from presets import FEW

import lensforge as lf
from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.search.automatic_schedule import preset_for
from lensforge.search.problem import Problems
from lensforge.search.scene_check import SceneCheck, light_requirements
from lensforge.search.start_faces import start_faces
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec, load_spec
from lensforge.spec.accuracy import PRESETS


def check(spec: Spec) -> SceneCheck:
    return SceneCheck.of(spec, build_source(spec.source), None)


def road_bounds(spec: Spec) -> dict[str, float]:
    """Most light of each limit of a road."""
    _, limits = light_requirements(spec, build_source(spec.source))
    return {limit.name: limit.possible for limit in limits if limit.by_lumens is not None}


def test_a_road_that_scatters_evenly_has_no_more_than_its_lumens_over_its_area(examples: Path, tmp_path: Path) -> None:
    """q = rho / pi: luminance is at most q m T lm / (s w), where all that two faces transmit lands on the road."""
    tan_gamma = np.linspace(0.0, 12.0, 2401)
    q = 0.2 / np.pi
    surface = tmp_path / "alike.csv"
    rows = [f"{t},{','.join(3 * [str(1e4 * q * (1.0 + t * t) ** -1.5)])}" for t in tan_gamma]
    surface.write_text("\n".join(["tan_gamma,0,90,180", *rows]))
    spec = load_spec(examples / "road_m3.toml").replace({"roads.0.surface_file": surface})
    lux = 0.8 * 6000.0 * normal_transmittance(1.4936) ** 2 / (30.0 * 7.0)
    luminance = road_bounds(spec)
    assert len(luminance) == 2
    for most in luminance.values():
        assert most == pytest.approx(q * lux, rel=2e-3)
    illuminance = road_bounds(spec.replace({"roads.0.lighting_class": "P3"}))
    assert list(illuminance.values()) == pytest.approx([lux, lux], rel=2e-3)
    with pytest.raises(InputError, match=r"upper bound 8\.79 lx .lumens and area .*more lumens, poles near"):
        check(spec.replace({"roads.0.lighting_class": "C0", "roads.0.lamp_lm": 2500.0})).require_light()


@pytest.mark.parametrize("name", ["road_m3", "road_luminance", "pedestrian"])
def test_the_first_lens_of_a_road_keeps_the_bounds_of_its_light(examples: Path, name: str) -> None:
    spec = load_spec(examples / f"{name}.toml")
    most = road_bounds(spec)
    light = lf.evaluate(Lens(start_faces(spec), spec, 0, FEW), rays=2**17)
    values = {limit.label: limit.metric.value for limit in light.limits if limit.label in most}
    assert len(values) == len(most) == 2 and all(0.0 < values[label] < most[label] for label in most)


@pytest.mark.parametrize(("road", "height_m"), [("road_m3", 9.0), ("road_wide", 12.0), ("road_luminance", 10.0)])
def test_rays_of_a_step_see_the_limits_of_a_road_as_many_more_do(examples: Path, road: str, height_m: float) -> None:
    changes = {"roads.0.pole_height_m": height_m, "optimise.robust": False}
    spec = load_spec(examples / f"{road}.toml").replace(changes)
    source = build_source(spec.source)
    preset = preset_for(spec, "draft")
    problem = Problems(spec, source, 2.5, None).of((9,))
    merit = problem.merit
    tables = problem.parametrisation.tables(*problem.parametrisation.start())

    def loss(rays: int) -> float:
        return float(merit.training_loss(merit.light_of(tables, source.sample(rays, 1)), uniform=False).loss)

    assert preset.effort.rays[0] == preset.design_rays == preset.effort.validation_rays == 2**17
    exact = loss(2**20)
    assert loss(preset.effort.rays[0]) == pytest.approx(exact, rel=0.25)
    assert loss(PRESETS["draft"].effort.rays[0]) > 2.0 * exact
