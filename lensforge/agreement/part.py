"""Agreement of ``export.json`` with the limits of the files, and with the triangles of the STL itself."""

from collections.abc import Iterator

import numpy as np

from lensforge.agreement.comparing import beyond, differing, judged, unlike
from lensforge.geometry.acceptance import PART_CRITERIA, mesh_volume_limit, part_criteria
from lensforge.geometry.part import Part

_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEAD_BYTES = 84  # name and count of a binary STL
_SINGLE, _ROUNDED = 1e-4, 1e-3  # relative: an STL has single precision, and volume is a difference of large numbers


def part_contradictions(part: Part) -> Iterator[str]:
    """Contradictions of the record of the files.

    Where a file is not the one that the record describes, its criteria are no judgement of it: only their limits count.
    """
    yield from _shop(part)
    if part.altered:
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
    yield from _criteria(part, area)


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
    yield from judged("criteria", part.criteria, part_criteria(measured, _volume_limit(part, area_mm2), remedies))


def _volume_limit(part: Part, area_mm2: float | None) -> float:
    """The limit of the mesh's volume: as stated, where the triangles allow it; their corners have been rounded."""
    stated = next((each.limit for each in part.criteria if each.name == "mesh_volume_change"), 0.0)
    if area_mm2 is None or part.volume_mm3 == 0.0:
        return stated
    limit = mesh_volume_limit(area_mm2, 1e-3 * part.triangulation.chord_error_um, part.volume_mm3)
    return stated if abs(stated - limit) <= _ROUNDED * abs(limit) else limit
