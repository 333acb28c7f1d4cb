"""Agreement of ``export.json`` with the limits of the files, and with the triangles of the STL itself."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from lensforge.agreement.comparing import beyond, differing, judged, unlike
from lensforge.geometry.acceptance import PART_CRITERIA, mass_g, mesh_volume_limit, part_criteria
from lensforge.geometry.keep_out_criterion import keep_out_criteria
from lensforge.geometry.keep_out_error import mesh_error_mm
from lensforge.geometry.part import STL_FILE, Part
from lensforge.geometry.untrimmed_criteria import untrimmed_criteria

_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEAD_BYTES = 84  # name and count of a binary STL
_AREA_OF_FACETS = 1.0  # relative, over the square of the rings: the facets of 3 to 24 rings lack 0.4 of their area
_SINGLE, _ROUNDED = 1e-4, 1e-3  # relative: an STL has single precision, and volume is a difference of large numbers


def part_contradictions(part: Part) -> Iterator[str]:
    """Contradictions of the record of the files.

    Where the STL is not the one that the record describes, its triangles say nothing about the record.
    """
    yield from _shop(part)
    yield from differing("mass_g", part.mass_g, mass_g(part.lens.spec, part.volume_mm3), "density and volume")
    yield from _keep_out(part)
    slack = (_ROUNDED + _AREA_OF_FACETS / max(part.triangulation.rings, 1) ** 2) * part.area_mesh_mm2
    least, most = part.area_mesh_mm2 - slack, part.area_mesh_mm2 + slack
    yield from beyond("area_mm2", part.area_mm2, least, most, "the facets of the mesh")
    if STL_FILE in part.altered:
        yield from _criteria(part, None)
        return
    count = (len(part.stl) - _HEAD_BYTES) // _TRIANGLE.itemsize
    if count < 1 or len(part.stl) != _HEAD_BYTES + count * _TRIANGLE.itemsize:
        yield f"lens.stl: {len(part.stl)} bytes are no triangles"
        return
    triangles = np.frombuffer(part.stl, _TRIANGLE, offset=_HEAD_BYTES)["corners"].astype(np.float64)
    yield from unlike("triangulation.triangles", part.triangulation.triangles, count, "lens.stl has")
    crossed = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = float(0.5 * np.linalg.norm(crossed, axis=1).sum())
    volume = float(np.einsum("ni,ni->", triangles[:, 0], crossed)) / 6.0
    if not np.isfinite(area + volume):
        yield "lens.stl: its corners are not finite"
        return
    slack = _SINGLE * abs(volume)
    yield from beyond(
        "volume_mesh_mm3", part.volume_mesh_mm3, volume - slack, volume + slack, "the triangles of lens.stl"
    )
    slack = _SINGLE * area
    yield from beyond("area_mesh_mm2", part.area_mesh_mm2, area - slack, area + slack, "the triangles of lens.stl")
    yield from _bounds(part, triangles.reshape(-1, 3))
    yield from _criteria(part, area)


def _keep_out(part: Part) -> Iterator[str]:
    """The distance from the keep-out is that of its two places, or less: these are known to a facet's size."""
    found, named = part.keep_out, part.lens.spec.constraints.keep_out
    if found is not None or part.watertight:  # nothing is measured with a mesh that is not closed
        yield from unlike("keep_out", found is not None, named is not None, "the spec's constraints.keep_out says")
    if found is not None:
        apart = float(np.linalg.norm(np.subtract(found.body_point_mm, found.keep_out_point_mm)))
        yield from beyond("keep_out.distance_mm", found.distance_mm, -np.inf, apart, "its places")
        facets = part.triangulation
        error_mm = mesh_error_mm(part.lens.spec.base, max(facets.rings, 1), 1e-3 * facets.chord_error_um)
        yield from differing("keep_out.error_mm", found.error_mm, error_mm, "the facets")


def _bounds(part: Part, corners: Float[np.ndarray, "n 3"]) -> Iterator[str]:
    """The box against the corners of the triangles, which are rounded to single precision."""
    for name, stated, found in zip(("least", "largest"), part.bounds_mm, _box(corners), strict=True):
        for axis, one, other in zip("xyz", stated, found, strict=True):
            slack = _SINGLE * max(abs(other), 1.0)
            yield from beyond(f"bounds_mm: {name} {axis}", one, other - slack, other + slack, "the corners of lens.stl")


def _box(corners: Float[np.ndarray, "n 3"]) -> tuple[list[float], list[float]]:
    return corners.min(axis=0).tolist(), corners.max(axis=0).tolist()


def _shop(part: Part) -> Iterator[str]:
    """Settings of the spec that the files carry; their date may be another."""
    shop, has = part.lens.spec.manufacture, "the spec has"
    yield from unlike("signature.author", part.signature.author, shop.author, has)
    yield from unlike("signature.organisation", part.signature.organisation, shop.organisation, has)
    width = shop.form_tolerance_um if part.step_schema == "AP242" else None
    stated = {tolerance.width_um for tolerance in part.form_tolerances}
    yield from unlike("form_tolerances", sorted(stated), [] if width is None else [width], has)
    if part.untrimmed_surfaces is not None:
        yield from unlike("untrimmed_surfaces.scale", part.untrimmed_surfaces.scale, shop.scale, has)


def _criteria(part: Part, area_mm2: float | None) -> Iterator[str]:
    """The criteria by the record's values; those of values that only a criterion holds keep them."""
    own = {criterion.name: criterion for criterion in part.criteria}
    stored = {name: float("nan") if each.value is None else each.value for name, each in own.items()}
    for name in ("step_valid", "watertight_3mf"):
        if stored.get(name, 0.0) not in (0.0, 1.0):
            yield f"criteria: {name}: value = {stored[name]:.6g}, must be 0 or 1"
    measured = {name: stored.get(name, float("nan")) for name in PART_CRITERIA} | {
        "form_error": part.form_error_nm.max,
        "normal_error": part.normal_error_mrad.max,
        "watertight": float(part.watertight),
    }
    if part.volume_mm3 != 0.0:
        change = abs(part.volume_mesh_mm3 / part.volume_mm3 - 1.0)
        yield from differing("criteria: mesh_volume_change", stored.get("mesh_volume_change"), change, "its volumes")
    remedies = {name: own[name].remedy if name in own else "" for name in PART_CRITERIA}
    derived = (
        *part_criteria(measured, _volume_limit(part, area_mm2), remedies),
        *untrimmed_criteria(part.untrimmed_surfaces),
        *keep_out_criteria(part.lens.spec, part.keep_out),
    )
    yield from judged("criteria", part.criteria, derived)


def _volume_limit(part: Part, area_mm2: float | None) -> float:
    """The limit of the mesh's volume: as stated, where the triangles allow it; their corners have been rounded."""
    stated = next((each.limit for each in part.criteria if each.name == "mesh_volume_change"), 0.0)
    if area_mm2 is None or part.volume_mm3 == 0.0:
        return stated
    limit = mesh_volume_limit(area_mm2, 1e-3 * part.triangulation.chord_error_um, part.volume_mm3)
    return stated if abs(stated - limit) <= _ROUNDED * abs(limit) else limit
