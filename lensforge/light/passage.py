"""Rays through one body by the compiled kernels on all cores, and back: the lens, or optics behind it."""

from collections.abc import Callable
from dataclasses import dataclass
from threading import local
from typing import Any, TypeVar, cast

import numpy as np
from jaxtyping import Float, Int8

from lensforge.kernels.adjoint import (
    BodyGradients,
    ByRaysIn,
    adjoint_memory,
    adjoint_of_pairs,
    adjoint_of_ways,
    same_way,
)
from lensforge.kernels.parallel import CHUNKS, in_chunks, in_pieces
from lensforge.kernels.precision import DOUBLE_PRECISION, Precision
from lensforge.kernels.ray_packet import empty_packet
from lensforge.kernels.trace import trace
from lensforge.kernels.traced_body import ByRaysOut, RaysIn, RaysOut, TracedBody, Ways

_WORTH_SHARING = 2**11  # rays: a millisecond of work
_Memory = TypeVar("_Memory")
_of_thread = local()


def _thread_buffer(make: Callable[..., _Memory], *arguments: Any) -> _Memory:
    """Kernel buffers of this thread, allocated once: zeroing them takes as long as tracing some hundred rays."""
    known = vars(_of_thread).setdefault("memory", {})
    if (make, arguments) not in known:
        known[make, arguments] = make(*arguments)
    return cast(_Memory, known[make, arguments])


@dataclass(frozen=True, eq=False)
class BodyPassage:
    """Rays that have reached a ``body``, their ``ways`` through it, and the rays behind it.

    ``body`` and the rays' rows of films, noise and shifts have the ``precision`` of the tracing.
    """

    body: TracedBody
    rays: RaysIn
    ways: Ways
    exits: RaysOut
    precision: Precision

    @staticmethod
    def of(
        body: TracedBody,
        rays: RaysIn,
        events: int,
        fates: Int8[np.ndarray, " n"] | None = None,
        *,
        axial: bool = False,
        fields: bool = False,
        precision: Precision = DOUBLE_PRECISION,
    ) -> "BodyPassage":
        """Trace ``rays`` through at most ``events`` events; those that ended before, by their ``fates``, stay.

        ``axial`` and ``fields``: whether to keep these for the rays that leave.
        """
        count = len(rays.emitted)
        sides = body.sides
        absorbs = len(rays.absorptions) > 0 or (sides is not None and bool((sides.mirrors > 0.0).any()))
        ways = Ways(np.empty((count, events)), None if sides is None else np.full((count, events), -1, dtype=np.int8))
        exits = RaysOut(
            points=np.zeros((count, 3)),
            directions=np.zeros((count, 3)),
            flux=np.empty(count),
            absorbed=np.zeros(count if absorbs else 0),
            sin2_exit=np.empty(count),
            fates=np.zeros(count, dtype=np.int8) if fates is None else fates.copy(),
            axial=None if sides is None and not axial else np.zeros(count if axial else 0),
            fields=np.zeros((count if fields else 0, 12)),
        )
        body = precision.of(body)
        rays = rays._replace(**{name: precision.of(getattr(rays, name)) for name in ("film_rows", "noise", "shifts")})
        run = precision.kernel(trace)

        def work(part: slice) -> None:
            run(rays.part(part), body, ways.part(part), exits.part(part), _thread_buffer(empty_packet, precision))

        in_pieces(work, count, worth=_WORTH_SHARING)
        return BodyPassage(body, rays, ways, exits, precision)

    @property
    def met(self) -> Int8[np.ndarray, "n e"]:
        """Faces that the rays met, as in :class:`Ways`; None for a double-freeform lens."""
        if self.ways.met is None:
            raise ValueError("rays that meet two faces in their order keep no way")
        return self.ways.met

    @property
    def axial(self) -> Float[np.ndarray, " n"] | None:
        """Flux (W) of each ray times the squared component of its field along z; None if not kept."""
        axial = self.exits.axial
        return axial if axial is not None and len(axial) == len(self.exits.flux) else None

    def gradients(self, by: ByRaysOut) -> Float[np.ndarray, "f side side"]:
        """Gradients by all tables, from sensitivities to the rays behind the body.

        The flux that a lost ray carried counts as a constant.
        """
        totals = np.zeros((CHUNKS, *self.body.tables.shape))
        if self.ways.met is None:
            run = self.precision.kernel(adjoint_of_pairs)

            def work(chunk: int, part: slice) -> None:
                ways = self.ways.part(part)
                packet = _thread_buffer(adjoint_memory, 0, self.precision).packet
                run(self.rays.part(part), self.body, ways, self.exits.fates[part], by.part(part), totals[chunk], packet)

            in_chunks(work, len(self.rays.emitted), worth=_WORTH_SHARING)
        else:
            self._back(by, totals, ByRaysIn.none_of(0))
        return totals.sum(axis=0)

    def back(self, by: ByRaysOut) -> ByRaysIn:
        """Sensitivities to the incoming rays from those to the rays behind a body in polarised light."""
        before = ByRaysIn.none_of(len(self.rays.emitted))
        self._back(by, np.zeros((CHUNKS, 0, *self.body.tables.shape[1:])), before)
        return before

    def _back(self, by: ByRaysOut, totals: Float[np.ndarray, "c f side side"], before: ByRaysIn) -> None:
        if by.by_axial is None:
            by = by._replace(by_axial=np.zeros(len(by.by_flux)))
        events = self.ways.lengths.shape[1]
        met = self.met

        def work(chunk: int, part: slice) -> None:
            gradients = BodyGradients(totals[chunk], before.part(part))
            adjoint_of_ways(
                self.rays.part(part),
                self.body,
                self.ways.part(part),
                self.exits.fates[part],
                by.part(part),
                same_way(met[part]),
                gradients,
                _thread_buffer(adjoint_memory, events),
            )

        in_chunks(work, len(self.rays.emitted), worth=_WORTH_SHARING)
