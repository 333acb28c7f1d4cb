"""glTF models of a part: the lens, alone and with rays of its LED, and the plate or all lamps with this lens."""

from collections.abc import Iterator

import numpy as np

from lensforge import seeds
from lensforge.cad.glb_file import Lines, glb_bytes
from lensforge.cad.mesh import BodyMesh
from lensforge.cad.mesh_files import parse_named_3mf
from lensforge.cad.part import Part
from lensforge.cad.plate_result import PLATE_THREEMF_FILE
from lensforge.light.lens_light import judging_source
from lensforge.light.ray_lines import ENDS, ray_lines
from lensforge.scene.lens import Lens

GLB_FILE = "lens.glb"
LAMPS_GLB_FILE = "lamps.glb"
PLATE_GLB_FILE = "plate.glb"
RAYS_GLB_FILE = "lens_rays.glb"
_REACH = 3.0  # of rays that leave, over the part's largest distance from the LED
_ORANGE = (217, 119, 6)
_COLOURS = dict(zip(ENDS, (_ORANGE, *((190, 24, 93 + 20 * k) for k in range(len(ENDS) - 1))), strict=True))


def models_of(part: Part, rays: int) -> Iterator[tuple[str, bytes]]:
    """The glTF files of a ``part`` by name; ``rays``: number of those in the file that has some, 0 for no such file."""
    mesh = parse_named_3mf(part.threemf)
    lens = part.lens
    name = lens.spec.name
    yield GLB_FILE, glb_bytes(mesh, name)
    if rays:
        yield RAYS_GLB_FILE, glb_bytes(mesh, name, lines=_rays_by_end(lens, mesh, rays))
    lamps = lens.spec.lens.apart(lens.of_own_lamps.spec.all_lamps)  # one linear lens stands over a whole row
    if part.plate_threemf is not None:
        yield PLATE_GLB_FILE, glb_bytes(parse_named_3mf(part.plate_threemf, PLATE_THREEMF_FILE), f"{name} plate")
    elif len(lamps) > 1 and lens.spec.plate is None:
        yield LAMPS_GLB_FILE, glb_bytes(mesh, name, [lamp.pose for lamp in lamps.lamps])


def _rays_by_end(lens: Lens, mesh: BodyMesh, count: int) -> dict[str, Lines]:
    """Lines of ``count`` rays of the LED by how they end."""
    first = next(iter(lens.by_state.values()))
    bundle = judging_source(first.spec).sample(count, seeds.of_own_rays(lens.seed))
    reach_mm = _REACH * float(np.linalg.norm(mesh.vertices, axis=1).max())
    drawn = ray_lines(first, bundle, reach_mm).by_end()
    return {f"rays: {end}": Lines(lines, _COLOURS[end]) for end, lines in drawn.items()}
