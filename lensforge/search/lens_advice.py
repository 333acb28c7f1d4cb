"""Advice on the kind of lens: the light that each has sent to such a target, or can at most, and which suits that best.

Drafts of each kind are known for common sizes (``search.designed_light``). Beyond these bounds decide: each kind turns
light by other means, and loses some (``scene.possible_light``); étendue bounds lenses of one size alike, and tells no
kind from another. What a kind can draw its declaration says: faces of one way draw any picture, pictures of several
ways overlap to a patch of light, and a mirror around the source gathers light.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from lensforge.light.receiver_light import LARGEST_NMSE
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import in_target, target_light
from lensforge.search.designed_light import DesignedLight, DraftPlace, designed_light, series_of
from lensforge.search.scene_check import light_requirements
from lensforge.search.start_faces import AngularSize, beam_of, pixel_angles_rad
from lensforge.sources.ray_bundle import Source
from lensforge.spec import Spec
from lensforge.spec.lens_section import LensShape, LightShape

# Share of the most light with which a simpler lens is advised. Around a half angle of 30 degrees the bound of two faces
# is 0.988 of that with total reflection, and designed lenses send 0.973; at 20 degrees 0.969 and 0.943
# (docs/validation.md, "Which lens").
_NEAR = 0.97
_OF_DRAFTS: tuple[LightShape, ...] = ("round", "patch")  # that are known
_CONVEX = 0.9  # of the area of its hull: the pixels of a disc 10 pixels wide have 0.93 of it
_UNEVEN = 0.05  # share of the light's variance within rings of equal angle: pixels of a round edge have less
_RINGS = 32
# Total reflection with levels lights an oval of 2.4 to 1 to an NMSE of 0.002, a line of 20 to 1 to 0.47, and a field
# whose middle lies 15 degrees off the axis, half of its width, to 0.10.
_LINE = 4.0  # a line is so much longer than wide
_BESIDE = 0.25  # off the axis by so much of the width


@dataclass(frozen=True)
class LensOption:
    """A kind of lens for some light: ``possible``, the largest share of it that such faces can turn to the target.

    ``designed``: what drafts like it reached; None where there are none.
    """

    kind: type[LensShape]
    possible: float
    designed: DesignedLight | None = None

    @property
    def reached(self) -> float | None:
        """Efficiency of drafts like it; None where there are none."""
        return None if self.designed is None else self.designed.of_possible * self.possible

    @property
    def phrase(self) -> str:
        """The bound and the lens in words."""
        return f"{100.0 * self.possible:.3g} % with a {self.kind.title}"

    @property
    def reached_phrase(self) -> str:
        """The light that drafts reached and the lens in words; empty where there are none."""
        if self.designed is None or self.reached is None:
            return ""
        return f"{self.reached:.2f} with a {self.kind.title} (NMSE {self.designed.nmse:.1g})"


@dataclass(frozen=True)
class LensAdvice:
    """The kinds of lens for some light, by their names, and the one that is ``advised``.

    ``shares``: of those that suit its shape, the simplest first, the light over the most: ``by_drafts``, or by their
    bounds where drafts are not known.
    """

    options: Mapping[str, LensOption]
    advised: str
    shares: Mapping[str, float]
    by_drafts: bool = False

    @staticmethod
    def of(specs: Mapping[str, Spec], source: Source, shape: LightShape) -> "LensAdvice":
        """Advice on ``specs`` that differ in the kind of their lens, the simplest first; ``shape``: of the light."""
        place = DraftPlace.of(next(iter(specs.values())), source) if shape in _OF_DRAFTS else None
        options = {
            kind: LensOption(
                type(spec.lens),
                turned_share(spec, source),
                None if place is None else designed_light(series_of(spec), place),
            )
            for kind, spec in specs.items()
        }
        return LensAdvice.among(options, shape)

    @staticmethod
    def among(options: Mapping[str, LensOption], shape: LightShape) -> "LensAdvice":
        """Advice on ``options``, the simplest first, for light of that ``shape``."""
        suitable = {kind: option for kind, option in options.items() if shape in option.kind.draws} or options
        reached = _reached(suitable)
        light = reached or {kind: option.possible for kind, option in suitable.items()}
        most = max(light.values())
        shares = {kind: value / most if most > 0.0 else 1.0 for kind, value in light.items()}
        advised = next(kind for kind, share in shares.items() if share >= _NEAR)
        return LensAdvice(options, advised, shares, by_drafts=bool(reached))

    @property
    def phrase(self) -> str:
        """The bounds of all kinds in words, the largest first, and what drafts reached, where they are known."""
        ordered = sorted(self.options.values(), key=lambda option: -option.possible)
        bounds = f"upper bound {', '.join(option.phrase for option in ordered)}"
        if not self.by_drafts:
            return bounds
        drafts = sorted(self.options.values(), key=lambda option: -(option.reached or 0.0))
        reached = ", ".join(filter(None, (option.reached_phrase for option in drafts)))
        return f"{bounds}; drafts like this reached an efficiency of {reached}"

    @property
    def why(self) -> str:
        """Words on the choice: of the kinds that suit the light, their shares of the most."""
        if len(self.shares) == 1:
            passing = f"whose drafts have an NMSE of {LARGEST_NMSE:g} or less"
            return f"{self.advised} is used, the only kind {passing if self.by_drafts else 'that suits this light'}"
        ratios = ", ".join(f"{kind} has {share:.4g}" for kind, share in self.shares.items())
        if self.by_drafts:
            return f"{self.advised} is used, the simplest with {_NEAR:g} of the most or more: {ratios}"
        by_bound = f"{self.advised} is used, the simplest with {_NEAR:g} of the largest bound or more: {ratios}"
        return f"{by_bound}; drafts like this are not known"


def _reached(options: Mapping[str, LensOption]) -> dict[str, float]:
    """Efficiency of drafts of the kinds whose pattern passes, or of all where none does; empty where one is not known.

    A kind whose drafts send more light to a wrong pattern is none to advise.
    """
    known = {kind: (option.reached, option.designed.nmse) for kind, option in options.items() if option.designed}
    if len(known) < len(options):
        return {}
    passing = {kind: light for kind, (light, nmse) in known.items() if light is not None and nmse <= LARGEST_NMSE}
    return passing or {kind: light for kind, (light, _) in known.items() if light is not None}


def turned_share(spec: Spec, source: Source) -> float:
    """Largest share of the light that can reach the target by all laws but étendue."""
    target = light_requirements(spec, source)[0][0]
    bounds = target.bounds
    return target.possible if bounds is None else min(bounds.by_refraction, bounds.by_symmetry)


def light_shape(spec: Spec) -> LightShape:
    """Shape of the target's light on the first receiver: round, a patch around the axis or beside it, or a picture."""
    receiver = receivers_of(spec, spec.evaluate.pixels)[0]
    light = target_light(spec.all_receivers[0].targets, receiver)
    rows, columns = np.nonzero(in_target(light))
    corners = np.stack((columns, rows), axis=1)[:, None] + np.array([(0, 0), (0, 1), (1, 0), (1, 1)])
    if len(rows) < _CONVEX * ConvexHull(corners.reshape(-1, 2)).volume:
        return "picture"
    size = AngularSize.of(spec)
    if size.wide_rad > _LINE * size.narrow_rad:
        return "picture"
    if beam_of(spec).least_rad > 0.0 or size.off_axis_rad > _BESIDE * size.narrow_rad:
        return "beside"
    return "round" if _is_round(light, receiver) else "patch"


def _is_round(light: Float[np.ndarray, "h w"], receiver: PosedReceiver) -> bool:
    """True where the light depends on the angle from the axis of the lens alone."""
    angles = pixel_angles_rad(receiver).ravel()
    rings = np.minimum((angles / angles.max() * _RINGS).astype(int), _RINGS - 1)
    values = light.ravel()
    counts = np.maximum(np.bincount(rings, minlength=_RINGS), 1)
    means = np.bincount(rings, values, minlength=_RINGS) / counts
    return float(np.var(values - means[rings])) < _UNEVEN * float(np.var(values))
