"""Effect of the clamping base on the light: the part with its base, polished or black, against the part without one.

The design ignores the base. Here all light is followed, with reflections, through the mesh of the part with its base
and through that of the part without one, always the same rays; prints the rows of docs/results.md. NMSE is against the
target on the first receiver, on 32 pixels along its longer side, where ray noise is small; the change is the NMSE of
the picture against the one without base.

python benchmarks/base_effect.py cad_out/flat_top cad_out/pi cad_out/cross
"""

import sys
from pathlib import Path

import numpy as np

from lensforge.cad.custom_base import join_mesh, read_custom_base
from lensforge.cad.mesh import build_mesh
from lensforge.cad.mesh_files import stl_bytes
from lensforge.cad.patch import fit_patch
from lensforge.cad.plan import make_plan
from lensforge.light.metrics import nmse
from lensforge.proof.facet_casting import Grid
from lensforge.proof.nonsequential_trace import Base, Cause, Limits, PartBody, follow
from lensforge.proof.part_mesh import PartMesh, read_part_mesh
from lensforge.proof.proof_inputs import screens_of
from lensforge.scene.lens import Lens, load_lens
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import target_light
from lensforge.sources.build_source import build_source
from lensforge.spec import BaseSection

RAYS, SEED, RINGS, PIXELS = 2**14, 2**42, 96, 32
COLUMNS = ("design", "base", "flux fraction", "direct light on the base", "NMSE", "change")


def mesh_with_base(lens: Lens, base: BaseSection) -> PartMesh:
    """The mesh of the lens on ``base``, as its STL holds it."""
    mesh = build_mesh(make_plan(fit_patch(lens.inner), fit_patch(lens.outer), base), RINGS)
    if base.file is not None:
        mesh = join_mesh(mesh, read_custom_base(base.file), 1e-3)
    return read_part_mesh(stl_bytes(mesh))


def rows(directory: Path, count: int) -> list[tuple[str, ...]]:
    lens = load_lens(directory / "lens.json")
    spec = lens.spec
    source = build_source(spec.source, spec.lens.dispersion)
    rays = source.sample(min(count, source.ray_count or count), SEED)
    emitted, section, receiver = float(rays.flux.sum()), spec.all_receivers[0], receivers_of(spec, PIXELS)[0]
    screen = screens_of(spec, PIXELS)[0]
    target = target_light(section.targets, receiver)
    cases: list[tuple[str, BaseSection, Base]] = [
        ("none", BaseSection(kind="none"), "polished"),
        ("polished", spec.base, "polished"),
        ("black", spec.base, "black"),
    ]
    found: list[tuple[str, ...]] = []
    before = None
    for name, base, finish in cases:
        part = mesh_with_base(lens, base)
        body = PartBody(part, Grid(part.mesh), lens.media, finish)
        escaped = follow(body, rays, Limits()).escaped()
        places = screen.land(escaped.points, escaped.directions)
        picture, inside = screen.irradiance(places, escaped.flux), screen.in_window(places)
        touched = inside & (escaped.causes == Cause.BASE)
        before = picture if before is None else before
        change = float(np.sum((picture - before) ** 2) / np.sum(before**2))
        figures = (escaped.flux[inside].sum() / emitted, escaped.flux[touched].sum() / emitted, nmse(picture, target))
        shown = (f"{figures[0]:.4f}", f"{100.0 * figures[1]:.3f} %", f"{figures[2]:.4f}", f"{change:.1e}")
        found.append((directory.name, name, *shown))
    return found


def main() -> None:
    print("| " + " | ".join(COLUMNS) + " |")
    print("|" + "---|" * len(COLUMNS))
    for name in sys.argv[1:]:
        for row in rows(Path(name), RAYS):
            print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
