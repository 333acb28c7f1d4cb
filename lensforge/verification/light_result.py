"""Results on the light of the part: its flux budget, and that of rays which verification has drawn."""

from lensforge.records import Count, Metric, Record, Share


class PartFlux(Record):
    """The flux budget of the part; shares of the emitted flux."""

    detected: Share
    outside: Share
    missed: Share
    total_reflection: Share
    absorbed: Share = 0.0
    cover_glass: Share = 0.0
    reflected: Share


class PartMissed(Record):
    """Flux that never reaches the receiver's plane, by cause; shares of the emitted flux.

    ``base``: met on the way in or in the body. ``starts_outside``: met the outside of the lens before the inside.
    """

    no_hit: Share
    starts_inside: Share
    starts_outside: Share = 0.0
    base: Share
    back_into_cavity: Share
    missed_receiver: Share


class OwnRays(Record):
    """Light of rays that verification has drawn from the description of the source, not by the design's sampler.

    Sent through the mesh, against the light of the design: ``efficiency`` in the window, with ``efficiency_design``;
    ``nmse_less_noise`` of the picture against the design's, without the noise of either, None where that of the
    design's is not known. Every ray counts in ``flux``, those that are lost by ``missed_by_cause``.
    """

    rays: Count
    efficiency: Metric
    efficiency_design: Metric
    nmse_less_noise: Metric | None
    flux: PartFlux
    missed_by_cause: PartMissed
