"""A measured face in front of several LEDs, and on a board with lenses of two kinds."""

from dataclasses import replace
from typing import Any

import numpy as np
from presets import FEW
from scenes import NO_TOLERANCES, random_surface, small_spec, sphere, tolerance_changes
from several_lamps import BOTH, FAR, KINDS, NEAR, board

from lensforge.addons.measure import measured_facts
from lensforge.addons.measure.measured_surface import ChangedLens
from lensforge.addons.measure.measurement_result import MeasuredLight
from lensforge.light.simulation import TracedLens, traced_light
from lensforge.scene.lens import Lens


def lens_for(leds: dict[str, Any]) -> Lens:
    """A lens without tolerances, for these LEDs."""
    inner, outer = (random_surface(seed, 3.0 * seed, 0.01, (9, 25)) for seed in (1, 2))
    return Lens.double(inner, outer, small_spec(**tolerance_changes(NO_TOLERANCES), **leds), 0, FEW)


def test_a_measured_face_changes_the_light_of_each_led() -> None:
    """As through the lens for that LED alone; the page names each, and the top of the record is the first."""
    both = lens_for(BOTH)
    rays = 2**12
    dent = sphere(0.05)
    cuts, _ = ChangedLens.of(both, "inner", rays)
    lights = cuts.by_led(cuts.lights(None, dent, sphere(0.02)))
    for led, source in (("near", NEAR), ("far", FAR)):
        alone, _ = ChangedLens.of(lens_for({"source": source}), "inner", rays)
        design, measured, corrected = alone.lights(None, dent, sphere(0.02))[""]
        wanted = MeasuredLight(
            design=design.metrics,
            measured=measured.metrics,
            corrected=corrected.metrics,
            change=corrected.replicates.change_from(design.replicates),
        )
        assert lights[led] == wanted and wanted.change.efficiency.value != 0.0
    assert list(lights) == ["near", "far"] and lights["near"] != lights["far"]
    shown = {fact.key: fact for fact in measured_facts._lights(lights, "expected")}
    assert shown["nmse_far"].metric == lights["far"].corrected.nmse and shown["nmse_far"].label.endswith("(NMSE), far")
    assert shown["efficiency_change_far"].value == 100.0 * lights["far"].change.efficiency.value


def test_a_measured_face_of_one_kind_changes_the_lamps_that_have_it() -> None:
    """Against a board whose second kind is that part: two of its three lamps."""
    whole = board({})
    cuts, _ = ChangedLens.of(whole.of_kind("b"), "inner", 2**14)
    design, measured = cuts.lights(None, sphere(0.1))[""]
    part = replace(whole, others={"b": {**KINDS["b"], "inner": sphere(3.1)}})
    for light, lens in ((design, whole), (measured, part)):
        traced = TracedLens.of(lens, cuts.nodes_per_sigma)
        wanted = traced_light(traced, lens.spec, cuts.leds[""], 2**14, 0)
        assert np.abs(light.map - wanted.map).sum() < 1e-3 * wanted.map.sum(), "a ray or two at the edge of a pixel"
    assert np.abs(measured.map - design.map).sum() > 0.01 * design.map.sum()
