"""Most light that étendue and two refractions leave for each limit, where the source can be built from its spec alone.

A folder need not hold the ray file of its source, so that for such a source nothing can be said afterwards.
"""

from dataclasses import dataclass

from lensforge.report.numerals import number
from lensforge.search.scene_check import AskedLight, asked_light
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec
from lensforge.spec.source_sections import ChipArraySource, DiscSource, RectangleSource, SquareSource

_WITHOUT_FILES = (SquareSource, RectangleSource, DiscSource, ChipArraySource)


@dataclass(frozen=True)
class PossibleLimit:
    """The largest value that a limit can reach, as words with its unit, and the ``law`` that says so."""

    words: str
    law: str


def possible_limits(spec: Spec) -> dict[tuple[str, float], PossibleLimit]:
    """Bounds by name and value of each lower limit on light or on a share of it; of other limits nothing is known."""
    if not spec.limits or not isinstance(spec.source, _WITHOUT_FILES):
        return {}
    _, limits = asked_light(spec, build_source(spec.source))
    found = {}
    for each in limits:
        if isinstance(each, AskedLight):
            possible = PossibleLimit(f"≤ {number(each.possible, 3)} {each.unit}", "étendue")
        else:
            possible = PossibleLimit(f"≤ {number(each.bounds.value, 3)}", each.bounds.law)
        found[each.name, each.asked] = possible
    return found
