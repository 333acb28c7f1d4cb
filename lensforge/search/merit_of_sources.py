"""The merit of one lens in several states, such as with several LEDs: the mean of their merits, or the worst of them.

Every step traces as many rays as for one state, shared out to all. Each has its own picture, whose error counts: a lens
whose pictures are good only together would be good in no state.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from lensforge.search.light_path import Pairs
from lensforge.search.merit import Merit, MeritFunction, MeritParts, SampledLight, SampleLoss
from lensforge.search.parameters import Parametrisation
from lensforge.search.scene_symmetry import traced_states
from lensforge.sources.ray_bundle import RayBundle
from lensforge.sources.several_sources import SeveralSources
from lensforge.spec import Spec

_SMOOTH = 0.25  # width of the smooth maximum over the mean NMSE


@dataclass(frozen=True)
class LightOfSources:
    """The light of each LED in one sample."""

    lights: tuple[SampledLight, ...]

    @property
    def emitted_w(self) -> float:
        """Flux (W) of all together."""
        return sum(light.emitted_w for light in self.lights)


@dataclass(frozen=True)
class MeritOfSources(Merit[LightOfSources]):
    """The merits ``members`` of ``source`` by their ``shares``, which add up to 1; ``worst``: the worst counts.

    A step sees a smooth maximum: each loss counts by ``exp(loss / width)``, the width a quarter of the mean NMSE. By
    the largest alone every step would follow another LED. Judgements take the largest itself.
    """

    parametrisation: Parametrisation
    source: SeveralSources
    members: tuple[MeritFunction, ...]
    shares: tuple[float, ...]
    worst: bool

    @staticmethod
    def of(
        spec: Spec,
        source: SeveralSources,
        parametrisation: Parametrisation,
        device: torch.device | None = None,
        single: bool = False,
    ) -> "MeritOfSources":
        """The merit for all states of ``spec``; each asks for its own targets and limits with its own flux.

        ``source``: the LED in all of them; of states that are mirror images of each other one is traced.
        """
        traced = traced_states(spec, source)
        members = tuple(MeritFunction.of(state.spec, state.led, parametrisation, device, single) for state in traced)
        total = sum(state.weight for state in traced)
        shares = tuple(state.weight / total for state in traced)
        leds = replace(source, sources=tuple(state.led for state in traced))
        return MeritOfSources(parametrisation, leds, members, shares, spec.optimise.over_sources == "worst")

    def light_of(self, tables: Float[Tensor, "f side side"], rays: RayBundle, pairs: Pairs = ()) -> LightOfSources:
        """The light of ``rays``, each LED's by itself, through the lens with these tables, or ``pairs`` of parts."""
        shared_out = zip(self.members, self.source.shared_out(rays), strict=True)
        return LightOfSources(tuple(merit.light_of(tables, some, pairs) for merit, some in shared_out))

    def training_loss(self, light: LightOfSources, uniform: bool, limit_weight: float = 1.0) -> SampleLoss:
        """The loss by one sample; NMSE and efficiency for the history are means by the shares."""
        by_source = [
            merit.training_loss(led_light, uniform, limit_weight)
            for merit, led_light in zip(self.members, light.lights, strict=True)
        ]
        losses = torch.stack([assessed.loss for assessed in by_source])
        nmse, efficiency = (
            self._mean([getattr(assessed, name) for assessed in by_source]) for name in ("nmse", "efficiency")
        )
        weights = losses.new_tensor(self.shares)
        if self.worst:
            weights = torch.softmax(losses.detach() / (_SMOOTH * nmse), dim=0)
        return SampleLoss((losses * weights).sum(), nmse, efficiency, by_source[0].images)

    def unbiased_merit(self, first: LightOfSources, second: LightOfSources, uniform: bool) -> MeritParts:
        """Merit without constraints from two independent samples, without their noise."""
        both = zip(self.members, first.lights, second.lights, strict=True)
        merits = [merit.unbiased_merit(led_light, second_light, uniform) for merit, led_light, second_light in both]
        if self.worst:
            return max(merits)
        return MeritParts(*map(self._mean, zip(*merits, strict=True)))

    def limits_missed(self, samples: Sequence[LightOfSources]) -> int:
        """Number of limits that the ``samples`` of the light do not keep, over all states."""
        by_state = zip(*(sample.lights for sample in samples), strict=True)
        return sum(merit.limits_missed(lights) for merit, lights in zip(self.members, by_state, strict=True))

    def joined(self, parts: Sequence[LightOfSources], emitted_w: float) -> LightOfSources:
        """The light of all ``parts``, in proportion, as a sample of ``emitted_w``."""
        factor = emitted_w / sum(part.emitted_w for part in parts)
        by_led = list(zip(*(part.lights for part in parts), strict=True))
        return LightOfSources(
            tuple(SampledLight.joined(same, factor * sum(part.emitted_w for part in same)) for same in by_led)
        )

    def _mean(self, values: Sequence[float]) -> float:
        return sum(share * value for share, value in zip(self.shares, values, strict=True))
