"""Random lenses of all kinds, not searched: of how many do the files fail by what ``verify`` asks?

    .venv/bin/python benchmarks/own_files.py 200

Each is exported as ``lensforge export`` does, and verified with 4,096 rays. A line for each: its kind, radius and
receiver, the criterion that is used most, and its share of the limit.
"""

import sys
from collections.abc import Iterator

import numpy as np

import lensforge as lf
from lensforge.search.start_faces import start_faces
from lensforge.spec import Spec, parse_spec
from lensforge.spec.accuracy import preset_of
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

KINDS = "double", "tir", "reflector"
MATERIALS = "PMMA", "PC"
RAYS = 4096
EFFORT = preset_of("draft").replace("own_files", evaluate_rays=2**14, verify_rays=RAYS)


def spec_of(random: np.random.Generator, kind: str) -> Spec:
    """A random scene: an LED of 0.5 to 2 mm, a lens 6 to 16 times as large, a target at 5 to 150 times its radius."""
    led_mm = round(float(random.uniform(0.5, 2.0)), 2)
    radius_mm = round(led_mm * float(random.uniform(6.0, 16.0)), 2)
    distance_mm = round(radius_mm * float(np.exp(random.uniform(np.log(5.0), np.log(150.0)))), 1)
    across_mm = round(distance_mm * float(random.uniform(0.3, 1.5)), 1)
    lens = {"kind": kind, **({} if kind == "reflector" else {"material": str(random.choice(MATERIALS))})}
    content = {
        "name": f"random_{kind}",
        "source": {"kind": "square", "side_mm": led_mm},
        "lens": lens,
        "constraints": {"max_radius_mm": radius_mm},
        "target": {"kind": "disc", "diameter_mm": across_mm, "distance_mm": distance_mm},
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


def verified(count: int, seed: int = 0) -> Iterator[tuple[lf.Lens, lf.Part, lf.Proof]]:
    """Part and proof of each of ``count`` lenses."""
    random = np.random.default_rng(seed)
    for number in range(count):
        lens = lens_of(random, KINDS[number % len(KINDS)])
        part = lf.build(lens)
        yield lens, part, lf.verify(part, lf.evaluate(lens))


def main() -> None:
    failed = 0
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    for lens, part, proof in verified(count):
        facts = [*part.criteria, *proof.deciding_criteria()]
        missed = [fact.key for fact in facts if fact.state == "fail"]
        light = [fact for fact in proof.criteria if "deviation_rms" in fact.key and fact.limit]
        most = max(light, key=lambda fact: float(fact.value or np.inf) / fact.bound)
        failed += bool(missed)
        constraints, section = lens.spec.constraints, lens.spec.all_receivers[0]
        print(
            f"{lens.spec.lens.kind:10s} r {constraints.max_radius_mm:6.2f} mm, {section.place}: {most.key} "
            f"{float(most.value or np.inf) / most.bound:.2f} of its limit, {part.triangulation.rings} rings; "
            f"{', '.join(missed) or 'passes'}",
            flush=True,
        )
    print(f"{failed} of {count} fail")


if __name__ == "__main__":
    main()
