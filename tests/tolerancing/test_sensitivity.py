from dataclasses import replace

import numpy as np
import pytest
from scenes import random_surface, small_spec, sphere

from lensforge.accuracy import PRESETS
from lensforge.evaluation.simulate import TracedLens
from lensforge.lens import Lens
from lensforge.receivers.plane import PlaneReceiver
from lensforge.sources.build import build_source
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.tolerancing.amounts import Amounts
from lensforge.tolerancing.perturbations import perturbations
from lensforge.tolerancing.perturbed_surfaces import Displaced, with_form_error
from lensforge.tolerancing.sensitivity import measure_sensitivity, perturbed
from lensforge.tolerancing.sensitivity_table import Sensitivity
from lensforge.tolerancing.shifted_source import ShiftedSource

U = fibonacci_hemisphere(3000)


def small_lens(roughness=0.01):
    inner, outer = random_surface(1, 3.0, roughness, (9, 25)), random_surface(2, 6.0, roughness, (9, 25))
    return Lens(inner, outer, small_spec(), 0, "draft")


def test_a_shifted_sphere_has_its_closed_form():
    shift = np.array([0.05, -0.02, 0.03])
    along = U @ shift
    exact = along + np.sqrt(36.0 - shift @ shift + along**2)
    assert np.abs(Displaced(sphere(6.0), tuple(shift)).radius(U) - exact).max() < 1e-12


def test_a_displaced_freeform_lies_on_the_moved_points():
    surface, shift, tilt = random_surface(3, 6.0, 0.02, (9, 25)), np.array([0.03, 0.02, -0.04]), 0.004
    radius = Displaced(surface, tuple(shift), tilt).radius(U)
    cosine, sine = np.cos(tilt), np.sin(tilt)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
    back = (radius[:, None] * U - shift) @ turn  # the inverse of a rotation is its transpose
    length = np.linalg.norm(back, axis=1)
    assert np.abs(length - surface.radius(back / length[:, None])).max() < 1e-9


def test_a_tilt_turns_y_towards_z():
    bump = random_surface(5, 6.0, 0.02, (9, 25))
    turned = Displaced(bump, tilt_rad=0.1).radius(np.array([[0.0, np.cos(0.1), np.sin(0.1)]]))
    assert turned == pytest.approx(bump.radius(np.array([[0.0, 1.0, 0.0]])), rel=1e-12)


@pytest.mark.parametrize("functions", [9, 81])
def test_the_form_error_has_its_rms_along_the_normal(functions):
    surface = random_surface(3, 6.0, 0.03, (9, 25))
    wrong = with_form_error(surface, functions, 1.75, 2e-3, seed=4)
    u = fibonacci_hemisphere(20_000)
    error = (wrong.radius(u) - surface.radius(u)) * np.sum(surface.normal(u) * u, axis=1)
    assert np.sqrt(np.mean(error**2)) == pytest.approx(2e-3, rel=0.01)


def test_source_and_receiver_shift_together_leave_the_picture_in_place():
    # Moving the source by s is moving both surfaces by -s and the picture by +s: compared hit by hit.
    lens, shift = small_lens(), (0.05, 0.0, 0.0)
    nominal = TracedLens.of(lens, 8.0)
    source = build_source(lens.spec.source)
    receiver = PlaneReceiver.of(lens.spec.target, 16)
    moved = receiver.land(nominal.trace(ShiftedSource(source, shift).sample(2000, 1)))
    errors = perturbations(lens, Amounts(), 0)
    back = {name: Displaced(getattr(lens, name), (-0.05, 0.0, 0.0)).radius for name in ("inner", "outer")}
    other = receiver.land(perturbed(nominal, replace(errors[0], surfaces=back)).trace(source.sample(2000, 1)))
    both = (moved.landed & other.landed).numpy()
    assert both.mean() > 0.6
    gap = (moved.hits - other.hits).numpy()[both] - np.array([0.05, 0.0])
    # The tables differ by some nm, which is micrometres 100 mm away, and more for the few rays near total reflection.
    assert np.quantile(np.abs(gap), 0.98) < 2e-3


def test_the_index_is_that_of_the_lens_plus_its_error():
    nominal = TracedLens.of(small_lens(), 2.5)
    error = perturbations(small_lens(), Amounts(index=2e-3), 0)[-1]
    assert perturbed(nominal, error).scene.refractive_index == pytest.approx(1.4936 - 2e-3, abs=1e-15)


def test_the_table_names_every_error_and_nothing_changes_without_one():
    lens = small_lens()
    source = build_source(lens.spec.source)
    found = measure_sensitivity(lens, source, PRESETS["draft"], rays=4096)
    assert found.inputs == {"lens": lens.sha256}
    kinds = " ".join(row.name for row in found.rows)
    for kind in ("low-order", "SRBF-scale", "decentre", "tilt", "gap", "source shift", "index"):
        assert kind in kinds
    for row in found.rows:
        assert row.change.nmse == pytest.approx(row.metrics.nmse.value - found.nominal.nmse.value)
    assert any(abs(row.change.nmse) > 1e-6 for row in found.rows)
    none = Amounts(**dict.fromkeys(Amounts.model_fields, 1e-12))
    still = measure_sensitivity(lens, source, PRESETS["draft"], rays=4096, amounts=none)
    assert max(abs(row.change.nmse) for row in still.rows) < 1e-4


def test_the_table_is_the_same_when_read_back_and_says_how_far_it_is(tmp_path):
    lens, steps = small_lens(), []
    amounts = Amounts(tilt_rad=2e-3)
    found = measure_sensitivity(
        lens,
        build_source(lens.spec.source),
        PRESETS["draft"],
        rays=1024,
        amounts=amounts,
        progress=lambda done, total: steps.append((done, total)),
    )
    found.write(tmp_path)
    assert Sensitivity.read(tmp_path) == found
    assert found.amounts.model_dump() == {
        "low_order_rms_mm": 1e-3, "fine_rms_mm": 1e-4, "decentre_mm": 0.02, "tilt_rad": 2e-3, "gap_mm": 0.02,
        "source_mm": 0.05, "index": 1e-3,
    }  # fmt: skip
    lenses = len(found.rows) + 1
    assert steps == [(done, lenses) for done in range(1, lenses + 1)]


def test_a_larger_error_does_more():
    lens = small_lens()
    source = build_source(lens.spec.source)
    reach = []
    for scale in (1.0, 10.0):
        amounts = Amounts(decentre_mm=0.02 * scale, source_mm=0.05 * scale)
        rows = measure_sensitivity(lens, source, PRESETS["draft"], rays=8192, amounts=amounts).rows
        reach.append(max(abs(row.change.nmse) for row in rows if "decentre" in row.name))
    assert reach[1] > 2.0 * reach[0]
