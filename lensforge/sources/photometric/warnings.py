"""Warnings on a photometric file, one line each: the same for a summary and for a design that takes its far field."""

from collections.abc import Iterator

from lensforge.sources.photometric.record import PhotometricFile

_FLUX_TOLERANCE = 0.01  # integral and stated flux of real files agree this well
_CUT_SHARE = 0.01  # of the peak: more than that at the last gamma, and the file has lost light beyond it
_MOST_LM_PER_W = 683.0


def far_field_warnings(found: PhotometricFile) -> tuple[str, ...]:
    """List what was not taken as it stands in the file, and what contradicts itself there."""
    return (*found.warnings, *_contradictions(found), *_cut(found))


def _contradictions(found: PhotometricFile) -> Iterator[str]:
    lumens, stated, watts = found.intensity.flux(), found.stated_lumens, found.watts
    if stated and abs(lumens / stated - 1.0) > _FLUX_TOLERANCE:
        yield f"its intensities integrate to {lumens:.6g} lm, the file states {stated:.6g} lm"
    if found.lamp_lumens and lumens > found.lamp_lumens * (1.0 + _FLUX_TOLERANCE):
        yield f"its light has {lumens:.6g} lm, its lamps only {found.lamp_lumens:.6g} lm: check its factors"
    if watts > 0.0 and lumens > _MOST_LM_PER_W * watts:
        yield f"{lumens / watts:.4g} lm per W, no light has more than 683: check its lumens and watts"


def _cut(found: PhotometricFile) -> Iterator[str]:
    table = found.intensity
    first, last = float(table.gamma_deg[0]), float(table.gamma_deg[-1])
    at_last = float(table.values[:, -1].max() / table.values.max())
    if last not in (90.0, 180.0) and at_last > _CUT_SHARE:
        yield (
            f"its last gamma is {last:g} degrees, with {100.0 * at_last:.3g} % of the largest intensity: light beyond "
            "is not in the file"
        )
    if first > 0.0:
        yield f"its first gamma is {first:g} degrees: no light is taken within that"
