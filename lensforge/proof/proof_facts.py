"""Facts of the verification: each independent tracer of the exported part against the design, and stray light."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from lensforge.proof.acceptance import facet_misses
from lensforge.proof.file_form import FileForm
from lensforge.proof.proof_result import (
    BrepCast,
    IndependentRays,
    LampsTogether,
    LandingDeviation,
    MitsubaCast,
    Proof,
    ReceiverProof,
    ReceiverStray,
    StrayLight,
)
from lensforge.results import Fact, FactState, Group
from lensforge.results.criteria import named, state_of
from lensforge.results.numerals import number, percent, quantity, square

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


_PRINT_MESH = Fact(
    "print_mesh",
    "Mesh",
    "too coarse for the light",
    notice="lens.step is right and decides; `lensforge export` without --rings makes a mesh as fine as the light asks",
)


def proof_facts(
    proof: Proof, designed: Mapping[tuple[str, str], float], lamp: str = "", lamps: str = "", *, on_plate: bool = False
) -> list[Group]:
    """A group for each receiver, with each LED; ``designed``: efficiency of the design's light by LED and receiver.

    ``lamp``: words on the one whose rays are compared, of several, ``lamps``: on all; ``on_plate``: all stand on one.
    """
    parts = [
        Group(
            "part",
            f"Exported part{lit.ending}",
            tuple(_receiver(lit, designed.get((lit.result.led, lit.receiver.name)), lamp)),
            lamp,
        )
        for lit in lit_receivers(proof)
    ]
    forms = [Group("forms", "Form of the files", tuple(_form(each, proof) for each in proof.forms))]
    if facet_misses(proof):
        parts[0] = replace(parts[0], facts=(*parts[0].facts, _PRINT_MESH))
    title = "All lamps of the plate" if on_plate else "All lamps with this lens"
    together = [
        Group(
            "together",
            f"{title}{lit.ending}",
            tuple(_together(lit.result.together[lit.index], lit.result, lamps, on_plate)),
        )
        for lit in lit_receivers(proof)
        if lit.result.together
    ]
    return [*parts, *(forms if proof.forms else []), *together]


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


def lit_receivers(result: Proof | StrayLight) -> list[LitReceiver]:
    """Every receiver with every LED."""
    return [
        LitReceiver(of_led, index, f", {led}{on}" if result.others else on)
        for led, of_led in result.by_led.items()
        for index, on in enumerate(map(partial(suffix, of_led.receivers), range(len(of_led.receivers))))
    ]


def _form(form: FileForm, proof: Proof) -> Fact:
    state = state_of(proof.criteria, f"{form.name}: form")
    note = f"largest, next to {form.face}"
    return Fact(f"form {form.name}", form.name, 1e3 * form.off_um, "nm", state=state, note=note, digits=2)


def _together(lit: LampsTogether, proof: Proof, lamps: str, on_plate: bool) -> Iterator[Fact]:
    judged = named(proof.criteria, f"{lit.name}: {'plate' if on_plate else 'lamps'}_nmse_vs_sum")
    note = f"{lamps}; ray noise alone: {number(lit.noise_floor_nmse, 3)}"
    yield Fact("nmse_vs_sum", "NMSE against the sum", lit.nmse_vs_sum, note=note, digits=3).judged_as(judged)
    label = "Efficiency of the plate" if on_plate else "Efficiency of all lamps"
    yield Fact.share("plate_efficiency", label, lit.efficiency, "through its mesh")


def tracer_groups(proof: Proof) -> list[Group]:
    """A row for every independent tracer that has run, on each receiver; distances are ray displacements."""
    rows = [row for lit in lit_receivers(proof) for row in _tracers(lit)]
    return [rows[0], _plain(proof), *rows[1:]]


def stray_facts(stray: StrayLight, lamps: str = "") -> list[Group]:
    """A group of the stray light on each receiver, with each LED; ``lamps``: words on those whose light it is."""
    return [
        Group(
            "stray",
            f"Stray light{lit.ending}",
            (*_stray(lit.result, lit.receiver, lamps), *_neighbours(lit.result)),
            lamps,
        )
        for lit in lit_receivers(stray)
    ]


def _neighbours(stray: StrayLight) -> tuple[Fact, ...]:
    if stray.lenses == 1:
        return ()
    note = f"share of one lamp's light that meets another of the {stray.lenses} lenses"
    return (Fact.share("neighbours", "Enters another lens", stray.neighbours, note),)


def stray_budget(receiver: ReceiverStray) -> tuple[list[tuple[str, float]], list[tuple[str, float]]]:
    """Losses by their ends and detected light by its cause: names with shares of the emitted flux above 0."""
    flux, causes = receiver.flux, receiver.detected_stray_by_cause.model_dump()
    lost = [(words, getattr(flux, name)) for name, words in _ENDS.items() if getattr(flux, name) > 0.0]
    stray = [(f"stray: {_CAUSES.get(name, name)}", share) for name, share in causes.items() if share > 0.0]
    return lost, [("detected as designed", flux.detected_direct), *stray]


def suffix(receivers: Sequence[object], index: int) -> str:
    """End of a title: the name of receiver number ``index``, nothing where it is the only one."""
    return f", {receivers[index].name}" if len(receivers) > 1 else ""  # type: ignore[attr-defined]


def _receiver(lit: LitReceiver, designed: float | None, lamp: str) -> Iterator[Fact]:
    proof, receiver, index = lit.result, lit.receiver, lit.index
    gap = receiver.against_design
    at = "at 1 m, " if receiver.far_field else ""
    yield Fact(
        "landing",
        "Ray displacement",
        *_length(gap.rms),
        state=_state(proof.criteria, receiver, index, "deviation_rms"),
        note=f"rms, {at}part against design; at most {quantity(*_length(gap.max), digits=2)}",
        digits=2,
    )
    yield Fact(
        "nmse_vs_design",
        "NMSE against the design",
        receiver.nmse_vs_design,
        state=_state(proof.criteria, receiver, index, "nmse_vs_design"),
        note=f"of the part; ray noise alone: {number(receiver.noise_floor_nmse, 3)}",
        digits=3,
    )
    yield Fact("nmse_same_rays", "NMSE with the same rays", receiver.nmse_same_rays, digits=3)
    note = "" if designed is None else f"the design has {percent(designed, 4)}"
    yield Fact.share("part_efficiency", "Efficiency of the part", receiver.efficiency, note)
    yield Fact("part_rays", "Rays through the part", proof.rays, note=lamp)


def _length(mm: float) -> tuple[float, str]:
    return (1e3 * mm, "µm") if mm < 0.1 else (mm, "mm")


def _tracer(lit: LitReceiver, title: str, facts: tuple[Fact, ...], says: str, names: Sequence[str]) -> Group:
    state = _state(lit.result.criteria, lit.receiver, lit.index, *names)
    return Group("tracer", f"{title}{lit.ending}", facts, says, state)


def _tracers(lit: LitReceiver) -> Iterator[Group]:
    proof, receiver = lit.result, lit.result.receivers[lit.index]
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


def _state(criteria: Sequence[Fact], receiver: ReceiverProof, index: int, *names: str) -> FactState:
    """State of the criteria of one receiver; those of all but the first carry its name."""
    start = f"{receiver.name}: " if index else ""
    return state_of(criteria, *(f"{start}{name}" for name in names))


def _gaps(deviation: LandingDeviation) -> tuple[Fact, ...]:
    named = (("rms", "rms", deviation.rms), ("p99", "99 %", deviation.p99), ("largest", "largest", deviation.max))
    return tuple(Fact(key, label, value, "mm", digits=2) for key, label, value in named)


def _stray(stray: StrayLight, receiver: ReceiverStray, lamps: str) -> Iterator[Fact]:
    gain = 100.0 * (receiver.efficiency - receiver.efficiency_sequential)
    reflections = f"share of the LED’s flux, by reflections; the base is {stray.base}"
    yield Fact.share("detected_stray", "Stray light in window", receiver.flux.detected_stray, reflections)
    yield Fact.share("stray_absorbed", "Absorbed", receiver.flux.absorbed, digits=3)
    sequential = f"without reflections {percent(receiver.efficiency_sequential, 4)}, {number(gain, 2)} points less"
    yield Fact.share("stray_efficiency", "With reflections", receiver.efficiency, f"efficiency; {sequential}")
    nmse = receiver.nmse_vs_sequential
    wrong = "" if nmse is None else f"an NMSE of {number(nmse, 2)}"
    yield Fact.share("misplaced", "Misplaced flux", receiver.misplaced_flux, wrong)
    if receiver.peak_of_mean is not None:
        note = "relative to the mean light on the receiver"
        yield Fact.share("stray_peak", "Peak of the stray light", receiver.peak_of_mean, note, digits=3)
    note = "; ".join(filter(None, (lamps, f"absorption {quantity(stray.absorption_per_mm, '1/mm')}")))
    yield Fact("stray_rays", "Rays followed", stray.rays, note=note)
