"""One forward evaluation: from parameters to the loss, and the numbers that tell how it goes."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from lensforge.optics.transmittance import normal_transmittance
from lensforge.optimisation.augmented_lagrangian import AugmentedLagrangian
from lensforge.optimisation.light import LightPath
from lensforge.optimisation.parameters import Parametrisation
from lensforge.receivers.collect import Collected
from lensforge.receivers.losses import mirror_mean, nmse_loss, shortfall_loss, uniformity_loss
from lensforge.receivers.plane import PlaneReceiver
from lensforge.receivers.targets import target_irradiance
from lensforge.sources.bundle import RayBundle, Source
from lensforge.spec import Spec
from lensforge.tracing.fused import Scene

# Weights of the terms beside an NMSE of order 0.01 to 1. A scene that is judged by evenness and efficiency wants its
# efficiency in every stage; where the image is judged, that is part of the NMSE.
_STRAY = 0.3
_IMAGE_PULLS = {"reflected": 0.3, "efficiency": 0.15}
_EVEN_PULLS = {"reflected": 0.1, "efficiency": 1.2}
# In the uniformity stage the image may be traded for an even mask.
_UNIFORM_VARIANCE = 10.0
_UNIFORM_SHORTFALL = 300.0
_UNIFORM_MARGIN = 0.03
_UNIFORM_IMAGE = 0.2


@dataclass(frozen=True)
class Evaluated:
    """One evaluation: the loss to descend (with pulls and constraints), and its parts for the history."""

    loss: Float[Tensor, ""]
    nmse: float
    efficiency: float
    fields: Float[Tensor, "c k"]


@dataclass(frozen=True)
class Objective:
    """The scene of a design: what rays meet on the way to the receiver, and the flux wanted of each of its pixels."""

    spec: Spec
    parametrisation: Parametrisation
    light: LightPath
    wanted: Float[Tensor, "p p"]
    mask: Bool[Tensor, "p p"] | None

    @staticmethod
    def of(
        spec: Spec, source: Source, parametrisation: Parametrisation, device: torch.device | None = None
    ) -> "Objective":
        """The wanted image carries the flux of the theoretical limit, so that efficiency is part of the NMSE.

        Rays are traced on ``device``, or by the compiled kernels for None; all else stays on the CPU.
        """
        receiver = PlaneReceiver.of(spec.target, spec.optimise.pixels)
        fresnel = spec.optimise.fresnel
        limit = (normal_transmittance(spec.lens.refractive_index) ** 2 if fresnel else 1.0) * source.flux_w
        wanted = torch.from_numpy(target_irradiance(spec.target, receiver.grid))
        scene = Scene(spec.lens.refractive_index, parametrisation.grid, fresnel)
        light = LightPath(scene, receiver, spec.evaluate.window_mm or spec.target.receiver_mm, device)
        mask = None
        if spec.target.uniform_mm is not None:
            # half a pixel more: the outermost strip of the region belongs to pixels whose centres are beside it
            mask = torch.from_numpy(receiver.grid.square_mask(spec.target.uniform_mm + receiver.grid.pitch_mm))
        return Objective(spec, parametrisation, light, wanted * limit, mask)

    def evaluate(
        self,
        weights: Float[Tensor, "k 2"],
        offsets: Float[Tensor, "2"],
        rays: RayBundle,
        constraints: AugmentedLagrangian,
        uniform: bool,
    ) -> Evaluated:
        """Trace ``rays``; ``uniform`` lets the evenness of the mask lead, and the image follow."""
        inner, outer = self.parametrisation.tables(weights, offsets)
        light = self.light.collect(inner, outer, rays)
        flux = mirror_mean(light.image, self.spec.lens.basis.symmetry)
        emitted_w = float(rays.weights.sum())
        nmse = nmse_loss(flux, self.wanted)
        image = nmse
        if uniform and self.mask is not None:
            image = _UNIFORM_IMAGE * nmse + self._unevenness(flux, self.mask)
        loss = image + _pulls(light, **(_IMAGE_PULLS if self.mask is None else _EVEN_PULLS)) / emitted_w
        fields = constraints.fields(inner, outer)
        efficiency = float(flux.detach().sum()) / emitted_w
        return Evaluated(loss + constraints.term(fields), nmse.item(), efficiency, fields)

    def _unevenness(self, flux: Float[Tensor, "p p"], mask: Bool[Tensor, "p p"]) -> Float[Tensor, ""]:
        variance = _UNIFORM_VARIANCE * uniformity_loss(flux, mask)
        return variance + _UNIFORM_SHORTFALL * shortfall_loss(flux, mask, _UNIFORM_MARGIN)


def _pulls(light: Collected, reflected: float, efficiency: float) -> Float[Tensor, ""]:
    """What the image cannot see (W): stray rays, total reflection, light lost."""
    return _STRAY * light.stray + reflected * light.reflected - efficiency * light.in_window
