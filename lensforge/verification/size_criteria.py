"""Acceptance of an exported part by its size: volume, area and box of each file against those of the export.

Rays see the optical faces alone. A base that is too thick, a bore that is too wide or a missing flange is seen here.
"""

from collections.abc import Iterator
from itertools import chain

from lensforge.criteria import Criterion, at_most
from lensforge.records import BodySize
from lensforge.verification.size_result import Faults, SizedFile, Sizes

# Faces that another CAD program has written again may lie so far off: a fifth of the finest tolerance of a drawing. The
# kernel of lensforge itself writes them again within 1e-6 mm.
REWRITTEN_MM = 0.002
# Facets of another program are excused up to this height: cadquery's finest setting (0.001 mm, 0.1 rad) makes 0.03 mm
# on a lens 25 mm wide. A base that is a tenth of a millimetre off is seen whatever the facets are.
MOST_CHORD_MM = 0.05
_SCALED_ALIKE = 0.1  # of the change: what facets make of a part scaled by 1.001, 0.03 of it for an exported mesh
_MOST_AREA = 0.01  # relative: what such facets lack of the area of a lens


def size_criteria(sizes: Sizes | None, faults: Faults) -> Iterator[Criterion]:
    """Criteria of all files; none where the size as exported is not known."""
    if sizes is None:
        return
    yield from _of_file(sizes, sizes.mesh, "", faults.mesh or _other(sizes.exported, sizes.mesh, "lens.stl"))
    if sizes.step is not None:
        words = faults.step or _other(sizes.exported, sizes.step, "lens.step")
        yield from _of_file(sizes, sizes.step, "brep_", words)


def other_body(sizes: Sizes | None, name: str) -> str:
    """Words on how the body in the file ``name`` differs in size from the export; empty where it does not."""
    file = None if sizes is None else sizes.step if name == "lens.step" else sizes.mesh
    if sizes is None or file is None or all(each.passed for each in _of_file(sizes, file, "", "")):
        return ""
    return _other(sizes.exported, file, name)


def _of_file(sizes: Sizes, file: SizedFile, prefix: str, remedy: str) -> Iterator[Criterion]:
    exported, found = sizes.exported, file.size
    moved_mm3 = REWRITTEN_MM * exported.area_mm2
    volume = (min(file.facets_mm3, MOST_CHORD_MM * exported.area_mm2) + moved_mm3) / exported.volume_mm3
    # Faces moved by d change volume by A d, and area by the same share at most.
    area = min(file.facets_mm2 / exported.area_mm2, _MOST_AREA) + moved_mm3 / exported.volume_mm3
    box = min(file.chord_mm, MOST_CHORD_MM) + sizes.chord_mm + REWRITTEN_MM
    changes = (
        ("volume_change", found.volume_mm3 / exported.volume_mm3 - 1.0, volume, "of the volume"),
        ("area_change", found.area_mm2 / exported.area_mm2 - 1.0, area, "of the area"),
        ("box_change", max(map(abs, _box_changes(exported, found))), box, "mm"),
    )
    yield from (at_most(f"{prefix}{each}", abs(value), limit, unit, remedy) for each, value, limit, unit in changes)


def _box_changes(exported: BodySize, found: BodySize) -> list[float]:
    pairs = zip(chain(*exported.bounds_mm), chain(*found.bounds_mm), strict=True)
    return [there - here for here, there in pairs]


def _scale(exported: BodySize, found: BodySize) -> float | None:
    """Ratio of all lengths, which the light may be too blunt to see; None where volume and area say otherwise."""
    here, there = ([high - low for low, high in zip(*size.bounds_mm, strict=True)] for size in (exported, found))
    ratios = [side / before if before > 0.0 else 0.0 for before, side in zip(here, there, strict=True)]
    scale = sum(ratios) / 3.0
    powers = (
        *((ratio, 1) for ratio in ratios),
        (found.area_mm2 / exported.area_mm2, 2),
        (found.volume_mm3 / exported.volume_mm3, 3),
    )
    alike = all(abs(ratio - scale**power) <= _SCALED_ALIKE * abs(scale**power - 1.0) for ratio, power in powers)
    return scale if alike and scale != 1.0 else None


def _other(exported: BodySize, file: SizedFile, name: str) -> str:
    """Words on a scale, or on the volume and the side of the box that differs most."""
    found, changes = file.size, _box_changes(exported, file.size)
    scale = _scale(exported, found)
    if scale is not None:
        return f"{name} is the lens scaled by {scale:.5g}: write it again as it was exported, in mm"
    side = max(range(6), key=lambda k: abs(changes[k]))
    stated, seen = (list(chain(*size.bounds_mm))[side] for size in (exported, found))
    place = f"{'least' if side < 3 else 'largest'} {'xyz'[side % 3]}"
    return (
        f"{name} is another body than the one exported: volume {found.volume_mm3:.5g} mm^3, exported "
        f"{exported.volume_mm3:.5g}; {place} {seen:.5g} mm, exported {stated:.5g}; correct it, or export again"
    )
