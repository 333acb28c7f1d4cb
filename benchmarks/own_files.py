"""Random lenses of all kinds, not searched: of how many do the files fail by what ``verify`` asks?

    python benchmarks/own_files.py 200                          # 20 to 60 s of processor time for each
    python benchmarks/own_files.py 50 --first 100 --kind tir
    python benchmarks/own_files.py 20 --kind extruded --kind extruded_tir   # linear lenses: by --kind alone

Each is exported as ``lensforge export`` does, and verified with 4,096 rays. A line for each: its number, by which it
can be made again, its kind, radius and receiver, the criterion that is used most, and its share of the limit.
"""

import argparse
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

import lensforge as lf
from lensforge.search.start_faces import start_faces
from lensforge.spec import Spec, parse_spec
from lensforge.spec.accuracy import preset_of
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

KINDS = "double", "tir", "reflector"
LINEAR = "extruded", "extruded_tir"
MATERIALS = "PMMA", "PC"
RAYS = 4096
EFFORT = preset_of("draft").replace("own_files", evaluate_rays=2**14, verify_rays=RAYS)


def spec_of(random: np.random.Generator, kind: str) -> Spec:
    """A random scene: an LED of 0.5 to 2 mm, a lens 6 to 16 times as large, a target at 5 to 150 times its radius."""
    led_mm = round(float(random.uniform(0.5, 2.0)), 2)
    radius_mm = round(led_mm * float(random.uniform(6.0, 16.0)), 2)
    distance_mm = round(radius_mm * float(np.exp(random.uniform(np.log(5.0), np.log(150.0)))), 1)
    across_mm = round(distance_mm * float(random.uniform(0.3, 1.5)), 1)
    lens: dict[str, object] = {"kind": kind}
    if kind != "reflector":
        lens["material"] = str(random.choice(MATERIALS))
    target = {"kind": "disc", "diameter_mm": across_mm, "distance_mm": distance_mm}
    if kind in LINEAR:
        lens |= {"length_mm": round(radius_mm * float(random.uniform(2.0, 20.0)), 1), "ends": "free"}
        target = {"kind": "rectangle", "width_mm": across_mm, "height_mm": 2.0 * across_mm, "distance_mm": distance_mm}
    content = {
        "name": f"random_{kind}",
        "source": {"kind": "square", "side_mm": led_mm},
        "lens": lens,
        "constraints": {"max_radius_mm": radius_mm},
        "target": target,
        "base": {"kind": "none"},
    }
    return parse_spec(content, "random")


def lens_of(random: np.random.Generator, kind: str) -> lf.Lens:
    """The faces from which a search begins; of two freeform faces with random weights of 25 functions."""
    spec = spec_of(random, kind)
    faces = start_faces(spec)
    if kind == "double":
        basis = SrbfBasis((9, 25), 1.75)
        noise = 0.02 * random.normal(size=(2, basis.size)) * basis.sigmas / basis.sigmas.max()
        offsets = [float(face.radius(np.array([[0.0, 0.0, 1.0]]))[0]) for face in faces.values()]
        faces = {
            name: SrbfSurface(basis, offset * weights, offset)
            for name, offset, weights in zip(faces, offsets, noise, strict=True)
        }
    return lf.Lens(faces, spec, 0, EFFORT)


def verified(numbers: Iterable[int], kinds: Sequence[str] = KINDS) -> Iterator[tuple[int, lf.Part, lf.Proof]]:
    """Part and proof of each of the lenses of these ``numbers``."""
    for number in numbers:
        lens = lens_of(np.random.default_rng(number), kinds[number % len(kinds)])
        part = lf.build(lens)
        yield number, part, lf.verify(part, lf.evaluate(lens))


def main() -> None:
    """Print a row for each lens, and how many fail."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", type=int, nargs="?", default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kind", choices=(*KINDS, *LINEAR), action="append")
    options = parser.parse_args()
    failed = 0
    for number, part, proof in verified(range(options.first, options.first + options.count), options.kind or KINDS):
        facts = [*part.criteria, *proof.deciding_criteria()]
        missed = [fact.key for fact in facts if fact.state == "fail"]
        light = [fact for fact in proof.criteria if "deviation_rms" in fact.key and fact.limit]
        most = max(light, key=_used)
        failed += bool(missed)
        spec = part.lens.spec
        print(
            f"{number:4d} {spec.lens.kind:10s} r {spec.constraints.max_radius_mm:6.2f} mm, "
            f"{spec.all_receivers[0].place}: {most.key} {_used(most):.2f} of its limit, "
            f"{part.triangulation.rings} rings; {', '.join(missed) or 'passes'}",
            flush=True,
        )
    print(f"{failed} of {options.count} fail")


def _used(fact: lf.Fact) -> float:
    return float(fact.value or np.inf) / fact.bound


if __name__ == "__main__":
    main()
