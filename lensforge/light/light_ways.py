"""Ways of the light through a lens of several faces: which it meets, by which it leaves, and its share of the flux."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float, Int, Int8
from pydantic import Field

from lensforge.optics.face_roles import OUTSIDE, RIM_FLANGE
from lensforge.results import Fact, Group, Metric, Record, Text
from lensforge.results.estimates import jackknife_metric
from lensforge.scene.body import Chain
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.light_ends import last_face
from lensforge.spec.lens_section import LensShape

_LONGEST = 4  # faces of a way that is told apart
_MOST_WAYS = 6  # told apart, the brightest; the shipped lenses have two or three


class LightWay(Record):
    """A way of the light through the lens, and its ``share`` of the emitted flux as it leaves.

    ``faces``: all that it meets, by name, from the source on; it leaves by the last. A single face: all light that
    leaves by it without being the exit. Empty: all other light that leaves.
    """

    faces: Annotated[tuple[Text, ...], Field(max_length=_LONGEST)]
    share: Metric

    @property
    def title(self) -> str:
        """Display name of the way."""
        if not self.faces:
            return "Other paths"
        return f"Through the {self.faces[0]}" if len(self.faces) == 1 else " → ".join(self.faces).capitalize()


@dataclass(frozen=True)
class FluxByWay:
    """Flux (W) that left the lens in each replicate by each way; its number has a digit for each face met.

    ``chain``: the faces from the source on, the exit last; None for a double-freeform lens, which has one way.
    """

    chain: Chain | None
    flux: Float[np.ndarray, "r w"]

    @staticmethod
    def none_yet(chain: Chain | None, replicates: int) -> "FluxByWay":
        """No flux."""
        return FluxByWay(chain, np.zeros((replicates, 1 if chain is None else (len(chain.names) + 1) ** _LONGEST)))

    def add(self, replicate: int, share: float, rays: ExitRays) -> None:
        """Count ``share`` of the flux of ``rays`` in ``replicate``."""
        if self.chain is not None and rays.met is not None:
            out = rays.left_lens
            numbers = _numbers(rays.met[out], len(self.chain.names))
            self.flux[replicate] += np.bincount(numbers, share * rays.flux[out], minlength=self.flux.shape[1])

    def leaked(self) -> Float[np.ndarray, "r k"]:
        """Flux (W) that left by each face before the exit, in each replicate; none of a double-freeform lens."""
        return self.flux[:, 1 : 1 if self.chain is None else len(self.chain.names)]

    def ways(self, emitted_w: float) -> tuple[LightWay, ...]:
        """The brightest ways to the exit, what leaves by each other face to the outside, and all other light."""
        if self.chain is None:
            return ()
        shares = self.flux / emitted_w
        names = self.chain.names
        brightest = np.argsort(-shares.sum(axis=0), kind="stable").tolist()
        to_exit = [number for number in brightest if number >= len(names) and shares[:, number].any()]
        sides = zip(names[:-1], self.chain.behind, strict=False)
        elsewhere = [k + 1 for k, (name, behind) in enumerate(sides) if behind == OUTSIDE and name != RIM_FLANGE.name]
        if self.chain.is_open:  # what is behind a mirror leaves nothing to tell
            elsewhere = [number for number in elsewhere if shares[:, number].any()]
        shares[:, 0] += shares[:, to_exit[_MOST_WAYS:]].sum(axis=1)
        shown = [*to_exit[:_MOST_WAYS], *elsewhere, *([0] if shares[:, 0].any() else [])]
        return tuple(
            LightWay(faces=tuple(_faces(number, names)), share=jackknife_metric(shares[:, number], float))
            for number in shown
        )


def _faces(number: int, names: Sequence[str]) -> Iterator[str]:
    while number:
        number, digit = divmod(number, len(names) + 1)
        yield names[digit - 1]


def _numbers(met: Int8[np.ndarray, "n e"], faces: int) -> Int[np.ndarray, " n"]:
    """Number of each ray's way; of its last face alone if that is not the exit, 0 for long ways."""
    count = (met >= 0).sum(axis=1)
    last = last_face(met).astype(int)
    digits = met[:, :_LONGEST].astype(int) + 1
    whole = digits @ (faces + 1) ** np.arange(digits.shape[1])
    return np.where(last < faces - 1, last + 1, np.where(count <= _LONGEST, whole, 0))


# Of the LED's flux, above which a leak is said: an evaluation knows it to a few thousandths of that.
_SAID = 0.01
_ABOVE = f"above {100.0 * _SAID:g} %"
_REFLECTS = "light that this face should reflect; {}, or give it a mirror (lens.{}.coating)"
_ALL = "design with more steps, a larger constraints.max_radius_mm or a smaller source"
_CAUSES = {
    "base": ("below the rim", f"light that leaves the rim of the body below z = 0; {_ALL}"),
    "flange": ("in the flange", "light on it; take more steps, a smaller source or a lower lens.flange.thickness_mm"),
    "backward": ("through the opening", "light that leaves backwards through the opening; raise the source"),
    "event_limit": ("in the body", "light still reflected back and forth; raise lens.events"),
    "total_reflection": ("at the exit", f"light that the exit reflects totally; {_ALL}"),
}


def leak_facts(lens: LensShape, ways: Sequence[LightWay], *budgets: Record) -> Iterator[Fact]:
    """A fact for each leak above 1 %: through a face that should reflect, or by the budgets ``budgets``."""
    if not ways:
        return
    for way in ways:
        name = way.faces[0] if len(way.faces) == 1 else ""
        if name and not lens.role(name).is_open and way.share.value > _SAID:  # an open mouth lets all light out
            yield Fact.share("leak", f"Lost through the {name}", way.share, _REFLECTS.format(_ALL, name), notice=_ABOVE)
    for cause, (place, remedy) in _CAUSES.items():
        share = next((getattr(budget, cause) for budget in budgets if hasattr(budget, cause)), 0.0)
        if share > _SAID:
            yield Fact.share("leak", f"Lost {place}", share, remedy, notice=_ABOVE)


def way_facts(ways: Sequence[LightWay]) -> Group:
    """The group of the shares of the ways."""
    note = "share of the LED’s flux that leaves the lens by these faces"
    facts = tuple(Fact.share(f"way_{k}", way.title, way.share, "" if k else note) for k, way in enumerate(ways))
    return Group("ways", "Flux by path", facts, note)
