"""Facts of the verification: each independent tracer of the exported part against the design, and stray light."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from lensforge.proof.cast_results import BrepCast, LandingDeviation, MitsubaCast
from lensforge.proof.proof_result import IndependentRays, Proof, ReceiverStray, StrayLight
from lensforge.results import Fact, Group
from lensforge.results.criteria import state_of, under_name
from lensforge.results.figure import facts_in
from lensforge.results.numerals import number, quantity, square

_CAUSES = {
    "inner_reflection": "reflected at the cavity",
    "outer_reflection": "reflected inside the outer face",
    "total_reflection": "totally reflected",
    "base": "by the base",
    "met_again": "met the lens again",
}
_ENDS = {
    "outside_direct": "outside the window",
    "outside_stray": "stray, outside the window",
    "backward": "back to the board",
    "absorbed": "absorbed in the lens",
    "cover_glass": "lost in the cover glass",
    "bodies": "lost in the further bodies",
    "base": "absorbed by the base",
    "too_dim": "below the flux cut-off",
    "leaked": "leaked at the mesh's edges",
}


def proof_facts(proof: Proof, lamp: str = "", lamps: str = "") -> list[Group]:
    """A group for each receiver, with each LED; the form of the files; and all lamps together.

    ``lamp``: words on the one whose rays are compared, of several, ``lamps``: on all.
    """
    on_receivers = lit_receivers(proof)
    parts = [Group("part", f"Exported part{lit.ending}", tuple(_part(lit, proof, lamp)), lamp) for lit in on_receivers]
    forms = [fact for form in proof.forms for fact in facts_in(proof, under_name(proof.criteria, form.name), form)]
    title = "All lamps of the plate" if proof.on_plate else "All lamps with this lens"
    together = [
        Group("together", f"{title}{lit.ending}", tuple(_together(lit, lamps)))
        for lit in on_receivers
        if lit.result.together
    ]
    return [*parts, *([Group("forms", "Form of the files", tuple(forms))] if forms else []), *together]


def _part(lit: "LitReceiver", proof: Proof, lamp: str) -> Iterator[Fact]:
    """Light on one receiver; beside that on the first, the number of rays and whether the mesh is for prints alone."""
    yield from facts_in(lit.result, lit.criteria, lit.receiver)
    if lit.index == 0:
        whole = proof if lit.result.led == proof.led else lit.result  # facets are judged with all LEDs
        yield from (replace(fact, note=lamp) if fact.key == "part_rays" else fact for fact in facts_in(whole))


def _together(lit: "LitReceiver", lamps: str) -> Iterator[Fact]:
    all_lamps = lit.result.together[lit.index]
    nmse, *others = facts_in(lit.result, under_name(lit.result.criteria, all_lamps.name), all_lamps)
    return iter([replace(nmse, note=f"{lamps}; {nmse.note}"), *others])


@dataclass(frozen=True)
class LitReceiver:
    """One receiver in the ``result`` with one LED: its ``index``, and the ``ending`` of titles that tell it apart."""

    result: Any
    index: int
    ending: str

    @property
    def receiver(self) -> Any:
        """The light on it."""
        return self.result.receivers[self.index]

    @property
    def criteria(self) -> Sequence[Fact]:
        """The criteria on it, without its name."""
        criteria: Sequence[Fact] = self.result.criteria
        return [*criteria] if self.index == 0 else under_name(criteria, self.receiver.name)


def lit_receivers(result: Proof | StrayLight) -> list[LitReceiver]:
    """Every receiver with every LED."""
    return [
        LitReceiver(of_led, index, f", {led}{on}" if result.others else on)
        for led, of_led in result.by_led.items()
        for index, on in enumerate(map(partial(suffix, of_led.receivers), range(len(of_led.receivers))))
    ]


def tracer_groups(proof: Proof) -> list[Group]:
    """A row for every independent tracer that has run, on each receiver; distances are ray displacements."""
    rows = [row for lit in lit_receivers(proof) for row in _tracers(lit)]
    return [rows[0], _plain(proof), *rows[1:]]


def stray_facts(stray: StrayLight, lamps: str = "") -> list[Group]:
    """A group of the stray light on each receiver, with each LED; ``lamps``: words on those whose light it is."""
    return [
        Group("stray", f"Stray light{lit.ending}", tuple(_stray(lit, lamps)), lamps) for lit in lit_receivers(stray)
    ]


def _stray(lit: "LitReceiver", lamps: str) -> Iterator[Fact]:
    yield from facts_in(lit.result, (), lit.receiver)
    for fact in facts_in(lit.result):
        yield replace(fact, note="; ".join(filter(None, (lamps, fact.note)))) if fact.key == "stray_rays" else fact


def stray_budget(receiver: ReceiverStray) -> tuple[list[tuple[str, float]], list[tuple[str, float]]]:
    """Losses by their ends and detected light by its cause: names with shares of the emitted flux above 0."""
    flux = receiver.flux
    causes = receiver.detected_stray_by_cause.model_dump()
    lost = [(words, getattr(flux, name)) for name, words in _ENDS.items() if getattr(flux, name) > 0.0]
    stray = [(f"stray: {_CAUSES.get(name, name)}", share) for name, share in causes.items() if share > 0.0]
    return lost, [("detected as designed", flux.detected_direct), *stray]


def suffix(receivers: Sequence[object], index: int) -> str:
    """End of a title: the name of receiver number ``index``, nothing where it is the only one."""
    return f", {receivers[index].name}" if len(receivers) > 1 else ""  # type: ignore[attr-defined]


def _tracer(lit: LitReceiver, title: str, facts: tuple[Fact, ...], says: str, names: Sequence[str]) -> Group:
    state = state_of(lit.criteria, *names)
    return Group("tracer", f"{title}{lit.ending}", facts, says, state)


def _tracers(lit: LitReceiver) -> Iterator[Group]:
    proof = lit.result
    receiver = lit.result.receivers[lit.index]
    noise = f"NMSE {number(receiver.nmse_vs_design, 2)}, ray noise alone {number(receiver.noise_floor_nmse, 2)}"
    names = ("deviation_rms", "nmse_same_rays", "nmse_vs_design", "flux_deviation")
    facts = (_rays(proof.rays), *_gaps(receiver.against_design))
    yield _tracer(lit, "Mesh with smooth normals", facts, f"lens.stl; {noise}", names)
    if receiver.brep is not None:
        yield _brep(lit, receiver.brep)
    if receiver.mitsuba is not None:
        yield _mitsuba(lit, receiver.mitsuba)
    if receiver.own_rays is not None:
        yield _independent_rays(lit, receiver.own_rays)


def _plain(proof: Proof) -> Group:
    plain = proof.plain_cast
    says = f"{number(plain.disagreements)} of {number(plain.casts)} first hits differ from those above"
    state = state_of(proof.criteria, "plain_cast_disagreements")
    return Group("tracer", "Plain ray cast by trimesh", (_rays(plain.rays),), f"lens.stl; {says}", state)


def _brep(lit: LitReceiver, brep: BrepCast) -> Group:
    fates = brep.against_design.fates
    ends = "every ray has the same fate" if fates == 0 else f"{number(fates)} rays have another fate"
    says = f"lens.step; {quantity(brep.against_mesh.rms, 'mm', digits=2)} rms from the mesh; {ends}"
    names = ("brep_deviation_rms", "brep_flux_deviation", "brep_fate_disagreements")
    facts = (_rays(brep.rays), *_gaps(brep.against_design))
    return _tracer(lit, "CAD kernel, face by face", facts, says, names)


def _mitsuba(lit: LitReceiver, mitsuba: MitsubaCast) -> Group:
    relation = "within" if mitsuba.nmse_vs_design <= mitsuba.noise_floor_nmse else "above"
    floor = number(mitsuba.noise_floor_nmse, 2)
    says = f"lens.stl; NMSE {number(mitsuba.nmse_vs_design, 2)}, {relation} the {floor} of ray noise alone"
    kinds = ("nmse_vs_design", "deviation_rms", "flux_deviation", "fate_disagreement_flux")
    facts = (_rays(mitsuba.rays), *_gaps(mitsuba.against_design))
    title = f"Mitsuba {mitsuba.version}, flat facets"
    return _tracer(lit, title, facts, says, [f"mitsuba_{kind}" for kind in kinds])


def _independent_rays(lit: LitReceiver, independent: IndependentRays) -> Group:
    redrawn, expected = (
        Fact.share("", "", share).text for share in (independent.efficiency, independent.efficiency_design)
    )
    says = f"lens.stl; efficiency {redrawn}, the design’s light {expected}"
    if independent.nmse_less_noise is not None:
        less_noise = independent.nmse_less_noise
        says += f"; NMSE less noise {square(less_noise.value, less_noise.standard_error)}"
    names = ("own_rays_efficiency", "own_rays_nmse", *(["own_rays_emission"] if lit.index == 0 else []))
    return _tracer(lit, "Independent rays of the LED", (_rays(independent.rays),), says, names)


def _rays(count: int) -> Fact:
    return Fact("rays", "Rays", count)


def _gaps(deviation: LandingDeviation) -> tuple[Fact, ...]:
    named = (("rms", "rms", deviation.rms), ("p99", "99 %", deviation.p99), ("largest", "largest", deviation.max))
    return tuple(Fact(key, label, value, "mm", digits=2) for key, label, value in named)
