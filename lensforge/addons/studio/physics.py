"""Physics of a spec that is being written: bounds, image of the LED, and kinds of lens, as ``lensforge new`` says."""

import numpy as np

from lensforge.addons.studio.page_frames import packed
from lensforge.light.lens_light import source_of
from lensforge.report.new_scene import NewScene
from lensforge.results.chart import light_unit
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import target_light
from lensforge.search.scene_check import SceneCheck, image_rad, light_requirements
from lensforge.search.start_faces import TargetStroke
from lensforge.spec import ReceiverSection, Spec
from lensforge.spec.spec_files import plain


def wanted(spec: Spec) -> bytes:
    """Frame of the light that the first state wants on each receiver, with the width of the LED's image there."""
    pixels = spec.evaluate.pixels
    heads = list[dict[str, object]]()
    arrays = dict[str, np.ndarray]()
    first = spec.in_first_state
    for number, (section, receiver) in enumerate(zip(first.all_receivers, receivers_of(first, pixels), strict=True)):
        image = image_rad(spec) / section.pixel_rad(pixels) * max(section.size) / pixels
        heads.append({**chart_head(section, receiver.grid.width, receiver.grid.height), "image": image})
        arrays[f"target{number}"] = target_light(section.targets, receiver)
    return packed({"kind": "wanted", "receivers": heads}, arrays)


def chart_head(
    section: ReceiverSection, width: float, height: float, lumens_per_watt: float | None = None
) -> dict[str, object]:
    """Name and size of a receiver's chart, and the unit of light on it."""
    far = type(section).unit == "deg"
    unit = light_unit(lumens_per_watt, far_field=far).symbol
    return {"name": section.name, "width": width, "height": height, "far": far, "unit": unit}


def bounds(spec: Spec) -> dict[str, object]:
    """Most light on each target and for each limit, and the widths of the LED's image and of the target."""
    rows = list[dict[str, object]]()
    for led, of_state in spec.by_state.items():
        targets, limits = light_requirements(of_state, source_of(of_state))
        names = [*(section.name for section in of_state.all_receivers), *(section.name for section in limits)]
        for name, light in zip(names, (*targets, *limits), strict=True):
            unit = light.unit if light.bounds is None else ""
            figures = {"possible": light.possible, "required": light.required, "unit": unit}
            rows.append({"name": f"{led} {name}".strip(), **figures, "words": light.possible_words})
    return {"rows": rows, "image_rad": image_rad(spec), "narrow_rad": TargetStroke.of(spec).width_rad}


def lens_kinds(spec: Spec) -> dict[str, object]:
    """The kinds of lens with the most light that each can send to the target, and the one that is advised."""
    light = {"target": _given(spec.target)} if spec.target is not None else {"receivers": [_given(spec.receivers[0])]}
    scene = NewScene.of("lens", light, _given(spec.source), spec.constraints.max_radius_mm)
    advice = scene.of_material("PMMA").advice()
    options = [
        {"kind": kind, "title": option.kind.title, "possible": option.possible}
        for kind, option in advice.options.items()
    ]
    return {"options": options, "advised": advice.advised}


def doubts(spec: Spec) -> dict[str, object]:
    """Lines on what no search can mend."""
    warnings = list[str]()
    for led, of_state in spec.by_state.items():
        lines = SceneCheck.of(of_state, source_of(of_state)).warnings()
        warnings += [f"{led}: {line}" if led else line for line in lines]
    return {"warnings": warnings}


def _given(section: object) -> dict[str, object]:
    return dict(plain(section.model_dump(exclude_unset=True)))  # type: ignore[attr-defined]
