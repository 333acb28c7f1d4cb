"""The light of an LED on its travel, traced at stops between its places in the states of a lens."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lensforge.light.replicate_rays import ReplicateRays
from lensforge.light.simulation import TracedLens
from lensforge.light.travel_stops import Travel, TravelStop
from lensforge.optics.pose import IN_PLACE
from lensforge.results.chart import Chart
from lensforge.scene.lens import Lens
from lensforge.scene.pixel_grid import bin_replicates, gaussian3
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.sources.ray_bundle import Source
from lensforge.spec import Spec
from lensforge.spec.accuracy import Preset

_STOPS = 7  # evenly spaced over the travel; those of the states come to them
_SHARE = 10  # of the rays that evaluate all states, over those of all stops
_LEAST_RAYS = 2**12
_PIXELS = 128  # along the longer side of the receiver
_SAME = 1e-9  # of the travel: places that differ by less are one


class TravelLine(NamedTuple):
    """The line of a travel from the place of the LED in the first state: its unit vector, and each state along it."""

    along: Float[np.ndarray, " 3"]
    states_mm: dict[str, float]

    @staticmethod
    def of(spec: Spec) -> "TravelLine | None":
        """The line on which the states of ``spec`` differ by the place of the LED alone; None where there is none."""
        first, *further = spec.by_state.values()
        if any(not _differ_by_place(first, state) for state in further) or not first.all_lamps.is_single:
            return None
        ways = np.subtract([state.source.position_mm for state in spec.by_state.values()], first.source.position_mm)
        lengths = np.linalg.norm(ways, axis=1)
        longest = float(lengths.max(initial=0.0))
        if longest == 0.0:
            return None
        along = ways[int(lengths.argmax())] / longest
        states_mm = ways @ along
        if np.abs(ways - states_mm[:, None] * along).max() > _SAME * longest:
            return None
        return TravelLine(along, dict(zip(spec.by_state, states_mm.tolist(), strict=True)))

    def stops(self) -> dict[float, str]:
        """Places (mm) of the stops in their order, and the state whose stop each is, empty between them."""
        ends = sorted(self.states_mm.values())
        by_place = {place: name for name, place in self.states_mm.items()}
        near = _SAME * (ends[-1] - ends[0])
        even = np.linspace(ends[0], ends[-1], _STOPS).tolist()
        between = {place: "" for place in even if min(abs(place - end) for end in ends) > near}
        return dict(sorted((between | by_place).items()))


def _differ_by_place(first: Spec, state: Spec) -> bool:
    moved = state.source.changed(position_mm=first.source.position_mm)
    return moved == first.source and state.lens == first.lens


def light_on_travel(lens: Lens, source: Source, preset: Preset, rays: int, seed: int) -> Travel | None:
    """The light at the stops of ``lens``; None where its states differ by more than a shift of the LED along a line.

    ``source``: in the first state. ``rays``: by which all states were evaluated. The picture is that on the widest of
    the first receivers of the states; None where these do not lie on one surface.
    """
    line = TravelLine.of(lens.spec)
    widest = _state_with_widest_receiver(lens.spec)
    if line is None or widest is None:
        return None
    receiver = receivers_of(widest, _PIXELS)[0]
    stops = line.stops()
    held = ReplicateRays.of(source, max(rays // (_SHARE * len(stops)), _LEAST_RAYS), seed)
    traced = TracedLens.of(replace(lens, spec=widest), preset.nodes_per_sigma)
    chart = Chart(*receiver.grid.size, receiver.is_far)

    def stop(place_mm: float, state: str) -> TravelStop:
        moved = held.rays.placed(IN_PLACE.at(place_mm * line.along))
        landed = receiver.land(traced.trace(moved))
        images = bin_replicates(landed.hits, landed.flux, receiver.grid, held.replicate, held.replicates)
        smooth = gaussian3(images, widest.evaluate.filter_variance) / receiver.pixel_measure
        return TravelStop.of(place_mm, state, smooth, chart)

    return Travel(
        stops=tuple(stop(place_mm, state) for place_mm, state in stops.items()),
        rays=len(held),
        place=widest.all_receivers[0].place,
        width=chart.width,
        height=chart.height,
        far_field=receiver.is_far,
    )


def _state_with_widest_receiver(spec: Spec) -> Spec | None:
    """The state whose first receiver is the largest; None where those of the states do not lie on one surface."""
    first = {name: receivers_of(state, _PIXELS)[0] for name, state in spec.by_state.items()}
    if len({(type(receiver), receiver.pose, receiver.radius_mm) for receiver in first.values()}) > 1:
        return None
    return spec.by_state[max(first, key=lambda name: first[name].grid.width)]
