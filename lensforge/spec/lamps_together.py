"""Demands of lamps together on the rest of a spec: room beside each other, receivers that all of them light.

Where their lenses are of several kinds, there is one LED.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from lensforge.spec.lamps_section import Lamps, LampsSection
from lensforge.spec.light_limits import LimitSection
from lensforge.spec.part_section import BaseSection
from lensforge.spec.receiver_fields import ReceiverSection
from lensforge.spec.receiver_sections import PlaneReceiver
from lensforge.spec.search_section import ConstraintsSection
from lensforge.spec.spec_section import rounded_up

_SAME = 1e-9  # relative: rounding of a place, and of the side of a receiver that is a lattice's period


def require_together(
    lamps: Lamps,
    apart: Lamps,
    limits: ConstraintsSection,
    base: BaseSection,
    receivers: Sequence[ReceiverSection],
    lenses: int,
) -> None:
    """Raise ``ValueError`` where lamps overlap, a receiver is between them, or ``photometry.lenses`` counts them.

    ``apart``: those that have a lens of their own, where some share one.
    """
    _require_apart(apart, limits, base)
    for receiver in receivers:
        _require_seen_by(receiver, lamps, limits)
    if lenses != 1:
        raise ValueError(f"photometry.lenses = {lenses}: [lamps] are {len(lamps)} already; leave out one of the two")


def _require_apart(lamps: Lamps, limits: ConstraintsSection, base: BaseSection) -> None:
    """Raise ``ValueError`` where two lenses, or their bases, would overlap."""
    lens_mm = 2.0 * limits.max_radius_mm
    if lamps.nearest_mm() < lens_mm * (1.0 - _SAME):
        raise ValueError(
            f"lamps: the nearest two stand {lamps.nearest_mm():.6g} mm apart, lenses of constraints.max_radius_mm = "
            f"{limits.max_radius_mm:g} overlap; allowed: at least {rounded_up(lens_mm)}, or a smaller lens"
        )
    if base.kind in ("none", "step"):
        return
    square = base.kind == "square" and base.flange_diameter_mm is None
    wide_mm = base.side_mm if square else base.flange_diameter_mm or base.diameter_mm
    nearest_mm = lamps.nearest_mm()
    room_mm = lamps.widest_square_mm() if square else nearest_mm
    if room_mm < wide_mm * (1.0 - _SAME):
        raise ValueError(
            f"lamps: the nearest two stand {nearest_mm:.6g} mm apart, their rims of base.kind = {base.kind!r} are "
            f"{wide_mm:g} mm wide; allowed: at least {rounded_up(nearest_mm * wide_mm / room_mm)}, or a smaller base"
        )


def _require_seen_by(receiver: ReceiverSection, lamps: Lamps, limits: ConstraintsSection) -> None:
    """Raise ``ValueError`` for a receiver between the lamps or inside a lens, or one that a lattice cannot light."""
    if lamps.period_mm is not None:
        _require_period(receiver, lamps.period_mm)
    for place, _, _ in lamps.lamps:
        away_mm = receiver.clear_mm(place)
        if away_mm <= limits.max_radius_mm:
            at = ", ".join(f"{coordinate:.4g}" for coordinate in place[: 3 if place[2] else 2])
            raise ValueError(
                f"receivers: {receiver.name or receiver.kind!r} is between the lamps: that at ({at}) mm has "
                f"{away_mm:.4g} mm to it, its lens needs more than constraints.max_radius_mm = "
                f"{limits.max_radius_mm:g}; move or turn the receiver"
            )
    if isinstance(receiver, PlaneReceiver) and receiver.window_mm not in (None, receiver.size):
        raise ValueError("receivers.window_mm: of lamps together the whole receiver counts; leave it out")


def _require_period(receiver: ReceiverSection, period: tuple[float, float]) -> None:
    """Refuse all but a level plane of one period."""
    level = isinstance(receiver, PlaneReceiver) and not any(receiver.facing[:2]) and receiver.rotation_deg == 0.0
    if not level or not np.allclose(receiver.size, period, rtol=1e-6, atol=0.0):
        raise ValueError(
            f'receivers: {receiver.name or receiver.kind!r}: lamps of kind = "endless" light level planes that are one '
            f"period of the lattice, {period[0]:.7g} x {period[1]:.7g} mm; take such a plane, or lamps of another kind"
        )


def require_kinds(
    section: LampsSection,
    receivers: Sequence[ReceiverSection],
    unfit: Mapping[str, bool],
    limits: Sequence[LimitSection],
) -> None:
    """Raise ``ValueError`` where lenses of several kinds cannot be: with any of the fields ``unfit``, seen by eyes."""
    kinds = section.lamps.kinds
    unfit = {**unfit, "a limit of kind luminance": any(limit.kind == "luminance" for limit in limits)}
    given = next((name for name, is_given in unfit.items() if is_given), None)
    if kinds and given is not None:
        raise ValueError(f"lamps.kinds: {given} goes with lamps of one lens; leave out one of the two")
    if any(kind.mirrors for kind in kinds) and all(receiver.is_far_field for receiver in receivers):
        raise ValueError(
            f'lamps.kinds = "place": in the far field all {len(section.lamps)} lamps are at one place; take a near '
            "receiver, kinds by name in a table, or leave it out"
        )
