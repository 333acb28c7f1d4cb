"""Segments of states: the light of each is for its own segment, and limits say how much of it may fall into others.

A segment is the shape of a state's target. A limit on crosstalk stands for limits on zones, one for each other segment:
it is searched, judged and shown as these are.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Annotated, ClassVar, Literal, get_args

from pydantic import Field

from lensforge.public import public
from lensforge.spec.light_limits import ZONES, Fraction, LimitSection, ZoneLimit, zone_of
from lensforge.spec.quantities import FluxShare, Quantity
from lensforge.spec.receiver_fields import ReceiverSection
from lensforge.spec.spec_section import check
from lensforge.spec.target_sections import TargetSection


@public
class CrosstalkLimit(LimitSection):
    """Light of each state in the segments of others: shares of the flux of its source.

    A segment is the shape of a state's target. The limit is one of `[[limits]]` of the spec, and holds in each state.
    """

    others: ClassVar[Mapping[str, type[Quantity]]] = {"share": FluxShare}

    kind: Literal["crosstalk"] = "crosstalk"
    at_most_share: Fraction = Field(description="Largest share of the flux of the source in another segment.")
    neighbours: Annotated[int, Field(ge=0, le=15)] = Field(
        default=0,
        description="Segments on each side, in the order of the states, that are left out: 1 begins with the next but "
        "one.",
    )
    at_least_own_share: Fraction | None = Field(
        default=None, description="Least share of the flux of the source in the segment of its own."
    )

    @check
    def _bounds_shares(self) -> None:
        if self.unit is not None or self.receiver is not None:
            raise ValueError("crosstalk is bounded by at_most_share, in segments on one receiver; leave out the rest")


def has_crosstalk(limits: Sequence[LimitSection]) -> bool:
    """True where one of ``limits`` is on crosstalk."""
    return any(isinstance(limit, CrosstalkLimit) for limit in limits)


def limits_on_zones(
    limits: Sequence[LimitSection], name: str, receivers: Mapping[str, Sequence[ReceiverSection]]
) -> tuple[LimitSection, ...]:
    """``limits`` of the state ``name``, those on crosstalk as limits on zones.

    ``receivers``: of every state by its name, in their order. Raises ``ValueError`` for states that have no segments.
    """
    segments = _segments(receivers)
    return tuple(zone for limit in limits for zone in _zones(limit, name, segments))


def _zones(limit: LimitSection, name: str, segments: Mapping[str, TargetSection]) -> Iterator[LimitSection]:
    if not isinstance(limit, CrosstalkLimit):
        yield limit
        return
    label = limit.name or "crosstalk"
    place = list(segments).index(name)
    if limit.at_least_own_share is not None:
        yield _zone(f"{label}: own segment", segments[name], at_least_share=limit.at_least_own_share)
    for other, (beside, segment) in enumerate(segments.items()):
        if abs(other - place) > limit.neighbours:
            yield _zone(f"{label}: in {beside}", segment, at_most_share=limit.at_most_share)


def _zone(name: str, segment: TargetSection, **share: float) -> ZoneLimit:
    return ZoneLimit.model_validate({"name": name, "zone": zone_of(segment), **share})


def _segments(receivers: Mapping[str, Sequence[ReceiverSection]]) -> dict[str, TargetSection]:
    """The target of each state. Raises ``ValueError`` unless all are shapes on one receiver, each another."""
    segments = {}
    (first, *_), *_ = receivers.values()
    for name, of_state in receivers.items():
        if len(of_state) > 1 or of_state[0].changed(targets=first.targets) != first:
            raise ValueError(f"crosstalk: {name} has other receivers than the first state; give all of them one place")
        segment, *others = of_state[0].targets
        if others or not isinstance(segment, get_args(ZONES)):
            kinds = ", ".join(kind.model_fields["kind"].default for kind in get_args(ZONES))
            raise ValueError(f"crosstalk: {name} has no segment; give it one target of kind {kinds}")
        segments[name] = segment
    for (name, segment), (other, same) in combinations(segments.items(), 2):
        if segment == same:
            raise ValueError(f"crosstalk: {name} and {other} have one segment; give each its own target")
    return segments
