"""Bounds of light against lenses that come near them: ten scenes of each kind, searched for the most light.

python benchmarks/possible_bounds.py [--kind tir] [--steps 10]        # a quarter of a minute for each lens
python benchmarks/possible_bounds.py --shipped                        # the stored light of the shipped specs

Sources are large for their lenses, and receivers near, tilted, to the side, far, or seen by several lamps: there
étendue binds. Searches are short; given ellipsoids image the LED on a disc. It ends with 1 where a share exceeds its
bound.

The shipped specs: efficiency and pattern error of their drafts and designs, as the pages have them, against the bounds
of each receiver.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import lensforge as lf
from lensforge.errors import LensforgeError
from lensforge.light.lens_light import source_of
from lensforge.scene.possible_light import PossibleLight, SourceLight
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import drawn_target
from lensforge.spec.shipped_specs import shipped_specs

Tables = dict[str, Any]

_LENSES: Tables = {
    "tir": {
        "source": {"kind": "square", "side_mm": 2.5},
        "constraints": {"max_radius_mm": 10.0, "max_height_mm": 15.0},
    },
    "reflector": {
        "source": {"kind": "disc", "diameter_mm": 4.0},
        "constraints": {"max_radius_mm": 18.0, "max_height_mm": 26.0},
    },
    "double": {"source": {"kind": "square", "side_mm": 3.0}, "constraints": {"max_radius_mm": 8.0}},
}


def _disc(distance_mm: float, diameter_mm: float, x_mm: float = 0.0, **more: Any) -> Tables:
    target = {"kind": "disc", "diameter_mm": diameter_mm, "distance_mm": distance_mm, "receiver_mm": 60.0}
    return {"target": {**target, "centre_mm": [x_mm, 0.0]}, **more}


def _beam(diameter_deg: float, x_deg: float = 0.0, **more: Any) -> Tables:
    target = {"kind": "disc", "diameter_deg": diameter_deg, "centre_deg": [x_deg, 0.0], "half_angle_deg": 60.0}
    return {"target": target, **more}


def _wall(kind: str, diameter_mm: float, **place: Any) -> Tables:
    return {"receivers": [{"kind": kind, "targets": [{"kind": "disc", "diameter_mm": diameter_mm}], **place}]}


def _scenes(kind: str) -> dict[str, Tables]:
    """Tables of ten specs by name, beside those of the lens."""
    free, radius = {"lens": {"levels": [25]}}, _LENSES[kind]["constraints"]["max_radius_mm"]
    tilted = {"centre_mm": [0.0, 1.5 * radius, 2.5 * radius], "tilt_deg": [-30.0, 0.0]}
    side = {"width_mm": 5.0 * radius, "height_mm": 5.0 * radius}
    lamps = {"lamps": {"kind": "grid", "columns": 2, "rows": 2, "pitch_mm": 3.0 * radius}}
    tall = {"constraints": {"max_height_mm": 2.5 * radius}} if kind != "double" else {}
    scenes = {
        "near disc": _disc(2.6 * radius, 0.6 * radius),
        "nearest disc": _disc(1.8 * radius, 0.3 * radius),
        "disc beside the axis": _disc(2.6 * radius, 0.6 * radius, 0.7 * radius, **free),
        "tilted plane": _wall("plane", radius, **tilted, **side) | free,
        "narrow beam": _beam(12.0),
        "beam aside": _beam(20.0, 25.0, **free),
        "tall lens, wide beam": _beam(60.0, **tall),
        "four lamps": _disc(8.0 * radius, 2.0 * radius, **lamps),
        "LED off the axis": _beam(30.0, source={"position_mm": [0.025 * radius, 0.0, 0.0]}),
        "dome": _wall("sphere", radius, radius_mm=4.0 * radius, half_angle_deg=60.0),
    }
    if kind == "reflector":
        del scenes["narrow beam"]
        for name, second, mouth in (
            ("near disc", 80.0, 70.0),
            ("nearest disc", 40.0, 36.0),
            ("disc far from the mouth", 80.0, 40.0),
        ):
            cup = {"kind": "focal_conic", "vertex_mm": 3.0, "second_focus_mm": second}
            given = {"cup": {"mirror": 1.0, "fixed": cup}, "mouth": {"offset_mm": mouth}}
            scenes[name] = _disc(second, 4.0, lens=given, constraints={"max_height_mm": mouth + 1.0})
    return scenes


def spec_of(kind: str, name: str, steps: int) -> lf.Spec:
    """The spec of one scene."""
    own = _scenes(kind)[name]
    lens = {"kind": kind, **own.get("lens", {})}
    if kind == "double":  # a step takes a tenth of the time of one through more faces
        lens["levels"], steps = [9, 81], 6 * steps
    levels = len(lens.get("levels", ())) + (kind != "double")
    content = {"name": kind, "base": {"kind": "none"}, **_LENSES[kind], **own, "lens": lens}
    for section in ("source", "constraints"):
        content[section] = {**_LENSES[kind][section], **own.get(section, {})}
    content["optimise"] = {"aim": "share", "rays": 2048, "steps_per_level": [steps] * levels}
    return lf.Spec.model_validate(content)


_DOCS = Path(__file__).parents[1] / "docs"
_NOISE = 1e-3  # of a stored efficiency or pattern error, at most
StoredLight = tuple[str, list[float], list[float]]  # kind of design; efficiency and NMSE on each receiver


def stored_light() -> Iterator[tuple[str, StoredLight]]:
    """Light of the drafts and of the designs that the pages show, by the name of the spec."""
    for name, light in json.loads((_DOCS / "gallery.json").read_text()).items():
        yield name, ("draft", light["efficiency"], light["nmse"])
    for name, design in json.loads((_DOCS / "figures.json").read_text())["designs"].items():
        yield name, (design["accuracy"], [design["efficiency"]["value"]], [design["nmse"]["value"]])


def bounds_of(spec: lf.Spec, efficiencies: list[float]) -> Iterator[tuple[float, float]]:
    """Most efficiency and least NMSE of the light that arrives, on each receiver."""
    light = SourceLight.of(source_of(spec), spec.media, lens=spec.lens)
    space = spec.lens.exit_space(spec.constraints)
    receivers = receivers_of(spec, spec.evaluate.pixels)
    for section, receiver, arriving in zip(spec.all_receivers, receivers, efficiencies, strict=False):
        physics = PossibleLight(light, receiver, space).certain
        target = drawn_target(section.targets, receiver)
        yield physics.in_window().value, physics.least_nmse(target.light, target.coverage > 0.0, arriving)


def compare_shipped() -> int:
    """Print a row for each receiver of each stored light, and count the bounds that are exceeded."""
    broken = 0
    specs = shipped_specs()
    print("| spec | design | efficiency | possible | NMSE | possible |\n|---|---|---|---|---|---|")
    for name, (kind, efficiencies, errors) in stored_light():
        if name not in specs:
            print(f"| {name} | {kind} | no shipped spec | | | |", flush=True)
            continue
        try:
            bounds = list(bounds_of(lf.load_spec(specs[name]), efficiencies))
        except LensforgeError as error:  # a vendor's ray file that is not there
            print(f"| {name} | {kind} | {error} | | | |", flush=True)
            continue
        for efficiency, error, (most, least) in zip(efficiencies, errors, bounds, strict=True):
            exceeded = efficiency > most + _NOISE or error < least - _NOISE
            broken += exceeded
            print(
                f"| {name} | {kind} | {efficiency:.4f} | {most:.4f} | {error:.4f} | {least:.4f} |"
                f"{' exceeded' if exceeded else ''}",
                flush=True,
            )
    missing = sorted(specs.keys() - dict(stored_light()).keys())
    print(f"{broken} exceeded; no stored light: {', '.join(missing) or 'none'}")
    return broken


def main() -> None:
    """Print a row for each scene: share in the target, its bound, their ratio, and the law that sets the bound."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", choices=list(_LENSES), action="append")
    parser.add_argument("--steps", type=int, default=10, help="gradient steps of each level")
    parser.add_argument("--shipped", action="store_true", help="the stored light of the shipped specs")
    options, broken = parser.parse_args(), 0
    if options.shipped:
        sys.exit(1 if compare_shipped() else 0)
    print("| lens | scene | share | possible | of it | by | seconds |\n|---|---|---|---|---|---|---|")
    for kind in options.kind or _LENSES:
        for name in _scenes(kind):
            begun = time.perf_counter()
            try:
                design = lf.design(spec_of(kind, name, options.steps), accuracy="draft", force=True)
                light = lf.evaluate(design.lens, rays=2**16).receivers[0]
            except LensforgeError as error:
                print(f"| {kind} | {name} | {error} | | | | |", flush=True)
                continue
            share, most = light.share_in_target, light.possible.share_in_target
            broken += share.value > most + 3.0 * (share.standard_error or 0.0)
            print(
                f"| {kind} | {name} | {share.value:.4f} | {most:.4f} | {share.value / most:.3f} "
                f"| {light.possible.law} | {time.perf_counter() - begun:.0f} |",
                flush=True,
            )
    sys.exit(1 if broken else 0)


if __name__ == "__main__":
    main()
