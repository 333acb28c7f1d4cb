"""Receivers as a page shows them: the light on each with its unit, its names, and its region of uniform light."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from lensforge.light.evaluation_result import Light
from lensforge.light.receiver_light import ReceiverLight
from lensforge.proof.proof_result import ReceiverProof
from lensforge.proof.stray_result import ReceiverStray
from lensforge.results.chart import LightUnit, light_unit
from lensforge.runs.results import Results
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_region import uniform_region
from lensforge.spec import Spec


@dataclass(frozen=True)
class ShownReceiver:
    """The light on receiver number ``index`` of a spec, in ``unit``; ``several``: it is one of many."""

    light: ReceiverLight
    unit: LightUnit
    spec: Spec
    index: int
    several: bool

    @property
    def place(self) -> str:
        """Place of the receiver; among several with its name."""
        return f"{self.light.place} ({self.light.name})" if self.several else self.light.place

    @property
    def heading(self) -> str:
        """Heading of its pictures; empty where it is the only one."""
        return f"{self.light.name}, {self.light.place}" if self.several else ""

    @property
    def window(self) -> str:
        """The part of it in which flux counts as detected, after "flux"."""
        return f"within {self.light.where}" if self.light.kind == "far_field" else self.light.where

    def picture_name(self, name: str) -> str:
        """Name of one of its pictures, unique on the page; that of the first receiver's is ``name`` itself."""
        return numbered(name, self.index)

    def mask(self, pixels: int) -> Bool[np.ndarray, "h w"] | None:
        """Its region of uniform light on ``pixels`` along the longer side; None where it has none."""
        sections = self.spec.all_receivers
        if self.index >= len(sections):
            return None
        return uniform_region(sections[self.index].targets, receivers_of(self.spec, pixels)[self.index])

    @property
    def mask_words(self) -> str:
        """Size of its region of uniform light, after "mask"; of several regions their number."""
        sections = self.spec.all_receivers
        targets = sections[self.index].targets if self.index < len(sections) else ()
        found = [(pair, target.unit) for target in targets if (pair := target.pair("uniform")) is not None]
        if len(found) != 1:
            return f"of {len(found)} parts"
        (width, height), unit = found[0]
        return f"of {_size(width, height, '°' if unit == 'deg' else ' mm')}"


def shown_receivers(results: Results) -> list[ShownReceiver]:
    """The receivers of the lens's own light; none where it has not been simulated."""
    light = results.find(Light)
    return [] if light is None else receivers_in(light, results.spec)


def receivers_in(light: Light, spec: Spec) -> list[ShownReceiver]:
    """The receivers of ``light``."""
    several = len(light.receivers) > 1
    return [
        ShownReceiver(
            receiver, light_unit(light.lumens_per_watt, far_field=receiver.chart.far_field), spec, index, several
        )
        for index, receiver in enumerate(light.receivers)
    ]


def numbered(name: str, index: int) -> str:
    """Name of a picture of receiver number ``index``, unique on the page; of the first it is ``name`` itself."""
    return f"{name}-{index + 1}" if index else name


def suffix(receivers: Sequence[ReceiverLight | ReceiverProof | ReceiverStray], index: int) -> str:
    """End of a title: the name of receiver number ``index``, nothing where it is the only one."""
    return f", {receivers[index].name}" if len(receivers) > 1 else ""


def capitalised(words: str) -> str:
    """``words`` as the beginning of a sentence."""
    return words[:1].upper() + words[1:]


def top_of(images: Iterable[np.ndarray]) -> float:
    """Peak of ``images``, the top of their scale; 1 where all of them are dark."""
    return max((float(image.max()) for image in images), default=0.0) or 1.0


def _size(width: float, height: float, unit: str) -> str:
    return f"{width:g}{unit}" if width == height else f"{width:g} × {height:g}{unit}"
