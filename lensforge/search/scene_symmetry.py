"""Mirrors that the scene of a search has: those of its LED and its targets, and those that change states for others.

A lens with a mirror lights two states that are mirror images of each other alike, but for left and right: such as the
chips to the left and to the right of a bar, each with its segment. A search traces one of them for both.
"""

from dataclasses import dataclass
from itertools import chain
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from jaxtyping import Float

from lensforge.errors import InputError
from lensforge.optics.efficacy import Efficacy
from lensforge.scene.housing import Housing
from lensforge.scene.limit_readings import light_limits
from lensforge.scene.receiver import PosedReceiver
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.scene.target_pattern import target_light
from lensforge.search.parameters import chart_mirrors, mirrored_light
from lensforge.sources.build_source import build_source
from lensforge.sources.ray_bundle import Source
from lensforge.sources.several_sources import SeveralSources, each_of
from lensforge.spec import Spec
from lensforge.spec.emitter_section import EmitterSection, PhotometricIntensity
from lensforge.spec.source_sections import ChipsSource, RaySetSource
from lensforge.surfaces.mirror_group import NAMES, contains
from lensforge.surfaces.placed_bodies import has_mirrors

_SAME = 2e-6  # of the largest light: pictures that differ by less are one
_MIRRORS = ("mirror_x", "mirror_y", "diagonal")
_AXES: dict[str, Literal["x", "y"]] = {"mirror_x": "x", "mirror_y": "y"}  # that each mirror turns around


def settled_symmetry(spec: Spec, source: Source) -> Spec:
    """``spec`` with ``lens.symmetry`` as one of ``surfaces.mirror_group``: for "auto" the largest that the scene has.

    Raises :class:`InputError` for a symmetry that source, target or a fixed surface lacks.
    """
    name = spec.lens.symmetry
    scene = _Scene.of(spec, source)
    if name == "auto":
        of_lens = [name for name in reversed(NAMES) if contains(spec.lens.largest_symmetry, name)]
        symmetry = next(name for name in of_lens if name != "diagonal" and scene.has_symmetry(name))
        return spec.changed(lens=spec.lens.changed(symmetry=symmetry))
    is_kept = scene.orbits(name) is not None
    for group in _groups(spec, name):
        if not contains(source.symmetry, group) and not (spec.all_states and is_kept):
            raise InputError(f"lens.symmetry = {group!r}: the source has only {source.symmetry!r}; use that, or 'auto'")
        lacking = _in_fixed(spec, group)
        if lacking is not None:
            raise InputError(f"lens.symmetry = {group!r}: {lacking} is not symmetric in this way; use 'auto'")
    if not is_kept:
        raise InputError(f"lens.symmetry = {name!r}: the target is not symmetric in this way; use 'auto'")
    return spec


def _groups(spec: Spec, name: str) -> list[str]:
    """Mirror groups of the lenses where the light of all lamps has the group ``name``, itself the first."""
    return list(dict.fromkeys([name, *(kind.symmetry(name) for kind in spec.all_lamps.kinds)]))


def _in_fixed(spec: Spec, name: str) -> str | None:
    """Field of a fixed surface, name of a body, or scene that lacks the symmetry; None if all have it."""
    lacking = (
        f"lens.{face}.fixed"
        for face, surface in spec.lens.fixed.items()
        if surface is not None and not contains(surface.symmetry, name)
    )
    bodies = (f"body {body.name!r}" for body in spec.media.bodies if not has_mirrors(body, name))
    housing = Housing.of(spec.scene)
    scene = ["scene"] if housing is not None and not housing.has_mirrors(name) else []
    return next(chain(lacking, bodies, scene), None)


@dataclass(frozen=True)
class TracedState:
    """A state that a search traces: its spec with the mirrors that it has by itself, its LED, and its ``weight``.

    The weight is that of all states whose mirror images it is.
    """

    spec: Spec
    led: Source
    weight: float


def traced_states(spec: Spec, source: Source) -> tuple[TracedState, ...]:
    """The states that tell the light of all, of a lens of ``spec`` with its symmetry, which is settled."""
    name = "none" if spec.lens.symmetry == "auto" else spec.lens.symmetry
    scene = _Scene.of(spec, source)
    traced = []
    for orbit in scene.orbits(name) or [(number,) for number in range(len(scene.states))]:
        first = scene.states[orbit[0]]
        symmetry = next(group for group in reversed(NAMES) if contains(name, group) and first.keeps(group))
        spec_alone = first.spec.changed(lens=first.spec.lens.changed(symmetry=symmetry))
        traced.append(TracedState(spec_alone, first.led, sum(scene.weights[number] for number in orbit)))
    return tuple(traced)


def traced_source(spec: Spec, source: Source) -> Source:
    """The source of the rays of a search: the LED in each state that it traces."""
    if not isinstance(source, SeveralSources):
        return source
    return SeveralSources(tuple(state.led for state in traced_states(spec, source)), source.wavelength_nm)


@dataclass(frozen=True)
class _Scene:
    """The ``states`` of ``spec`` with their weights, and its ``source``."""

    spec: Spec
    source: Source
    states: "tuple[_State, ...]"
    weights: tuple[float, ...]

    @staticmethod
    def of(spec: Spec, source: Source) -> "_Scene":
        """The scene of a spec and its source, which has the LED of each state."""
        pairs = zip(spec.by_state.values(), each_of(source), strict=True)
        weights = tuple(state.weight for state in spec.all_states) or (1.0,)
        return _Scene(spec, source, tuple(_State.of(state, led) for state, led in pairs), weights)

    def has_symmetry(self, name: str) -> bool:
        """True where LEDs, faces that are given, and targets have the mirrors of the group ``name``."""
        groups = _groups(self.spec, name)
        is_of_led = bool(self.spec.all_states) or all(contains(self.source.symmetry, group) for group in groups)
        is_of_faces = all(_in_fixed(self.spec, group) is None for group in groups)
        return is_of_led and is_of_faces and self.orbits(name) is not None

    def orbits(self, name: str) -> list[tuple[int, ...]] | None:
        """Numbers of the states that the mirrors of a group map to each other; None where one has no image."""
        orbits = [{number} for number in range(len(self.states))]
        for mirror in (mirror for mirror in _MIRRORS if contains(name, mirror)):
            for number in range(len(self.states)):
                image = self._image_of(number, mirror)
                if image is None:
                    return None
                joined = orbits[number] | orbits[image]
                for member in joined:
                    orbits[member] = joined
        return list(dict.fromkeys(tuple(sorted(orbit)) for orbit in orbits))

    def _image_of(self, number: int, mirror: str) -> int | None:
        state = self.states[number]
        if state.keeps(mirror):
            return number
        weight = self.weights[number]
        images = (image for image, weight_there in enumerate(self.weights) if weight_there == weight)
        return next((image for image in images if state.maps_to(self.states[image], mirror)), None)


class _Wanted(NamedTuple):
    """Light that is wanted on a receiver: its picture, or the places of a limit, with all else of that limit."""

    receiver: PosedReceiver
    picture: Float[np.ndarray, "h w"]
    limit: tuple[Any, ...] = ()

    def is_image(self, other: "_Wanted", mirror: str) -> bool:
        """True where ``other`` is the mirror image."""
        mirrors = chart_mirrors(self.receiver, mirror)
        same = self.receiver.pose == other.receiver.pose and self.receiver.grid == other.receiver.grid
        if mirrors is None or not same or self.limit != other.limit:
            return False
        image = torch.from_numpy(self.picture)
        mirrored = (2.0 * mirrored_light(image, mirrors) - image).numpy()  # the mean is that of both
        return np.allclose(mirrored, other.picture, rtol=_SAME, atol=_SAME * float(self.picture.max()))


@dataclass(frozen=True)
class _State:
    """A state as its mirror images are told: its LED, the lens in it, and what is wanted of its light.

    ``by_causes``: what else its limits ask, by the causes of losses; ``is_seen``: by eyes, whose places mirrors change.
    """

    spec: Spec
    led: Source
    wanted: tuple[_Wanted, ...]
    by_causes: tuple[tuple[Any, ...], ...]
    is_seen: bool

    @staticmethod
    def of(spec: Spec, led: Source) -> "_State":
        """The state with its specification and its LED."""
        receivers = receivers_of(spec, spec.optimise.pixels)
        sections = zip(spec.all_receivers, receivers, strict=True)
        wanted = [_Wanted(receiver, target_light(section.targets, receiver)) for section, receiver in sections]
        by_causes = []
        is_seen = False
        for limit in light_limits(spec, receivers, Efficacy(1.0, 1.0), 1.0):  # only the places count
            asked = (limit.receiver, limit.quantity, limit.sense, limit.bound, limit.share)
            if limit.quantity.of_losses:
                by_causes.append(asked)
            elif limit.quantity.of_view:
                is_seen = True
            else:
                receiver = receivers[limit.receiver]
                places = np.asarray(limit.readings.sum(axis=0)).reshape(receiver.grid.shape)
                wanted.append(_Wanted(receiver, places, asked))
        return _State(spec, led, tuple(wanted), tuple(by_causes), is_seen)

    def keeps(self, group: str) -> bool:
        """True where mirrors of ``group`` leave it as it is; a mirrored lens looks the same to a mirrored eye."""
        mirrors = [mirror for mirror in _MIRRORS if contains(group, mirror)]
        if not contains(self.led.symmetry, group):
            return False
        charts = [chart_mirrors(wanted.receiver, group) for wanted in self.wanted]
        if None in charts:
            return False
        return all(wanted.is_image(wanted, mirror) for wanted in self.wanted for mirror in mirrors)

    def maps_to(self, other: "_State", mirror: str) -> bool:
        """True where ``other`` is the mirror image: of its LED, and of what is wanted of its light."""
        axis = _AXES.get(mirror)
        is_same_lens = self.spec.lens == other.spec.lens and self.by_causes == other.by_causes
        if axis is None or not is_same_lens or self.is_seen or len(self.wanted) != len(other.wanted):
            return False
        if not _is_image(self.spec.source, other.spec.source, axis):
            return False
        unmatched = list(other.wanted)
        for wanted in self.wanted:
            place = next((k for k, image in enumerate(unmatched) if wanted.is_image(image, mirror)), None)
            if place is None:
                return False
            del unmatched[place]
        return True


def _is_image(led: EmitterSection, other: EmitterSection, axis: Literal["x", "y"]) -> bool:
    """True where ``other`` is the mirror image of ``led``, by their fields; of measured rays nothing is known."""
    if isinstance(led, RaySetSource) or type(led) is not type(other):
        return False
    if isinstance(led, ChipsSource):
        if isinstance(led.intensity, PhotometricIntensity):
            return False
    elif not contains(build_source(led.changed(**_UPRIGHT)).symmetry, f"mirror_{axis}"):
        return False
    return led.mirrored(axis).model_dump() == other.mirrored(axis).mirrored(axis).model_dump()


_UPRIGHT: dict[str, Any] = {"position_mm": (0.0, 0.0, 0.0), "tilt_deg": (0.0, 0.0), "rotate_z_deg": 0.0}
