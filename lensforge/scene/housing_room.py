"""Room between the bodies of a ``[[scene]]`` and the lens, and places that no light can reach past them."""

from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.scene.housing import Housing
from lensforge.scene.housing_mesh import contents_of, placed_mesh
from lensforge.spec import Spec
from lensforge.spec.housing_sections import HousingFile, HousingSection, bodies_of
from lensforge.surfaces.placed_bodies import depths, reach_mm
from lensforge.surfaces.solid_file import SolidMesh
from lensforge.surfaces.srbf import fibonacci_hemisphere

_AROUND = 128  # facets of the largest lens
_EXITS = 64  # places of the largest lens from which a place may be lit
_TOUCHES_MM3 = 1e-6  # that is rounding: a lens may stand in the very surface of a ceiling
_ON_ITS_WAY = 1.2  # of the size that the constraints allow
_WIDE = 40.0  # widths of the largest lens: as wide as that a body from a file may be in inches


def require_room(spec: Spec) -> None:
    """Raise :class:`InputError` for a body of the scene that reaches into the room of the lens or of its LED.

    That is the largest lens that the constraints allow, and what lies within the bodies behind it.
    """
    limits = spec.constraints
    size = limits.max_radius_mm, spec.lens.height_mm(limits), spec.lens.radius_about_axis
    for section in bodies_of(spec.scene):
        for lamp in spec.all_lamps.lamps:
            body = section.posed(section.pose.seen_from(lamp.pose))
            _require_beside_lens(body, contents_of([body]), *size)
            for optic in spec.media.bodies:
                vertices = placed_mesh(body).vertices
                depth = depths(optic, vertices, inner=False)
                inside = np.flatnonzero(np.isfinite(depth) & (depth > 0.0))
                if len(inside):
                    raise InputError(
                        f"scene: {section.name!r} reaches into body {optic.name!r}, at {_place(vertices[inside[0]])} "
                        "mm; bodies of the scene stand behind the last optic, move it away"
                    )


def exit_radius_mm(spec: Spec) -> float:
    """Radius (mm) of a ball about each lamp in which its light leaves the last optic, of a lens on its way, too."""
    return _ON_ITS_WAY * max(spec.lens.extent_mm(spec.constraints), reach_mm(spec.media.bodies))


@lru_cache(maxsize=64)
def _require_beside_lens(
    body: HousingSection, _contents: tuple[str, ...], radius_mm: float, height_mm: float, about_axis: bool
) -> None:
    from manifold3d import Error, Manifold

    mesh = _solid(placed_mesh(body))
    if mesh.status() != Error.NoError:
        raise InputError(f"scene: {body.name!r}: its bodies touch or overlap in edges; repair it in CAD, or join them")
    if about_axis:
        lens = Manifold.cylinder(height_mm, radius_mm, radius_mm, _AROUND)
    else:
        whole = Manifold.sphere(radius_mm, _AROUND).trim_by_plane((0.0, 0.0, 1.0), 0.0)
        lens = whole.trim_by_plane((0.0, 0.0, -1.0), -height_mm)
    common = mesh ^ lens
    if common.volume() > _TOUCHES_MM3:
        vertices = np.asarray(common.to_mesh64().vert_properties)[:, :3]
        nearest = vertices[np.linalg.norm(vertices, axis=1).argmin()]
        raise InputError(
            f"scene: {body.name!r} reaches into the room of the lens, at {_place(nearest)} mm: a lens of "
            f"constraints.max_radius_mm = {radius_mm:g} may be there; move the body, or lower max_radius_mm or "
            "max_height_mm"
        )


def _solid(mesh: SolidMesh) -> Any:
    from manifold3d import Manifold, Mesh64

    return Manifold(Mesh64(mesh.vertices, mesh.triangles.astype(np.uint64)))


def _place(point: Float[np.ndarray, "3"]) -> str:
    return f"({', '.join(f'{value:.4g}' for value in point)})"


def bodies_that_may_be_in_inches(spec: Spec) -> list[str]:
    """Words on each body from a file that is many times as wide as the largest lens."""
    lens_mm = 2.0 * spec.constraints.max_radius_mm
    lines = []
    for section in spec.scene:
        if isinstance(section, HousingFile):
            width_mm = float(np.ptp(placed_mesh(section).vertices, axis=0).max())
            if width_mm > _WIDE * lens_mm:
                lines.append(
                    f"scene: {section.name!r} is {width_mm:.4g} mm wide, {width_mm / lens_mm:.0f} times as wide as the "
                    "largest lens; drawn in mm and exported in inches it is 25.4 times too large"
                )
    return lines


def dark_share(spec: Spec, places: Float[np.ndarray, "k 3"], light: Float[np.ndarray, " k"], is_far: bool) -> float:
    """Share of the wanted ``light`` at ``places`` (mm, or directions of a far field) that bodies keep from any lens.

    That is where no line from the largest lens passes them all, of 64 places of it.
    """
    housing = Housing.of(bodies_of(spec.scene, from_afar=is_far))
    if housing is None or not light.any():
        return 0.0
    limits = spec.constraints
    exits = limits.max_radius_mm * fibonacci_hemisphere(_EXITS)
    exits[:, 2] = np.minimum(exits[:, 2], spec.lens.height_mm(limits))
    dark = np.ones(len(places), dtype=bool)
    for start in exits:
        rows = np.flatnonzero(dark)
        away = places[rows] if is_far else places[rows] - start
        length = np.linalg.norm(away, axis=1)
        reach = np.full(len(rows), np.inf) if is_far else length
        met = housing.shadow(np.broadcast_to(start, away.shape), away / length[:, None], reach).met
        dark[rows] = met
    return float(light[dark].sum() / light.sum())
