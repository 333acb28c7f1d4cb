"""Facts of the verification: each independent tracer of the exported part against the design, and stray light."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from lensforge.proof.cast_results import BrepCast, LandingDeviation, MitsubaCast
from lensforge.proof.proof_result import IndependentRays, Proof, ReceiverStray, StrayLight
from lensforge.results import Fact, Group
from lensforge.results.case import Case
from lensforge.results.criteria import state_of
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
    "housing": "blocked by housing",
    "second_wall": "met a further wall",
    "base": "absorbed by the base",
    "too_dim": "below the flux cut-off",
    "leaked": "leaked at the mesh's edges",
}


def proof_facts(proof: Proof, lamp: str = "", lamps: str = "") -> list[Group]:
    """A group for each receiver, with each LED; the form of the files; and all lamps together.

    ``lamp``, ``lamps``: captions of the lamp whose rays are compared, if there are several, and of all lamps.
    """
    parts = [
        Group("part", case.title("Exported part"), tuple(_part(case, lamp)), lamp) for case in proof.cases("receivers")
    ]
    forms = [fact for case in proof.cases("forms") for fact in case.facts()]
    title = "All lamps of the plate" if proof.on_plate else "All lamps with this lens"
    together = [Group("together", case.title(title), tuple(_together(case, lamps))) for case in proof.cases("together")]
    bodies = [Group("bodies", case.title("Light on a body"), tuple(case.facts())) for case in proof.cases("on_bodies")]
    return [*parts, *([Group("forms", "Form of the files", tuple(forms))] if forms else []), *together, *bodies]


def _part(case: Case[Proof], lamp: str) -> Iterator[Fact]:
    """Light on one receiver; beside that on the first, the number of rays and whether the mesh is for prints alone."""
    yield from case.facts()
    if case.number == 0:
        yield from (replace(fact, note=lamp) if fact.key == "part_rays" else fact for fact in facts_in(case.result))


def _together(case: Case[Proof], lamps: str) -> Iterator[Fact]:
    nmse, *further = case.facts()
    return iter([replace(nmse, note=f"{lamps}; {nmse.note}"), *further])


def tracer_groups(proof: Proof) -> list[Group]:
    """A row for every independent tracer that has run, on each receiver; distances are ray displacements."""
    rows = [row for case in proof.cases("receivers") for row in _tracers(case)]
    return [rows[0], _plain(proof), *rows[1:]]


def stray_facts(stray: StrayLight, lamps: str = "") -> list[Group]:
    """A group of the stray light on each receiver, with each LED; ``lamps``: caption of the lamps that emit it."""
    return [
        Group("stray", case.title("Stray light"), tuple(_stray(case, lamps)), lamps)
        for case in stray.cases("receivers")
    ]


def _stray(case: Case[StrayLight], lamps: str) -> Iterator[Fact]:
    yield from case.facts()
    for fact in facts_in(case.result):
        yield replace(fact, note="; ".join(filter(None, (lamps, fact.note)))) if fact.key == "stray_rays" else fact


def stray_budget(receiver: ReceiverStray) -> tuple[list[tuple[str, float]], list[tuple[str, float]]]:
    """Losses by their ends and detected light by its cause: names with shares of the emitted flux above 0."""
    flux = receiver.flux
    causes = receiver.detected_stray_by_cause.model_dump()
    lost = [(label, getattr(flux, name)) for name, label in _ENDS.items() if getattr(flux, name) > 0.0]
    stray = [(f"stray: {_CAUSES.get(name, name)}", share) for name, share in causes.items() if share > 0.0]
    return lost, [("detected as designed", flux.detected_direct), *stray]


def _tracer(case: Case[Proof], title: str, facts: tuple[Fact, ...], description: str, names: Sequence[str]) -> Group:
    state = state_of(case.criteria, *names)
    return Group("tracer", case.title(title), facts, description, state)


def _tracers(case: Case[Proof]) -> Iterator[Group]:
    receiver = case.record
    noise = f"NMSE {number(receiver.nmse_vs_design, 2)}, ray noise alone {number(receiver.noise_floor_nmse, 2)}"
    names = ("deviation_rms", "nmse_same_rays", "nmse_vs_design", "flux_deviation")
    facts = (_rays(case.result.rays), *_gaps(receiver.against_design))
    yield _tracer(case, "Mesh with smooth normals", facts, f"lens.stl; {noise}", names)
    if receiver.brep is not None:
        yield _brep(case, receiver.brep)
    if receiver.mitsuba is not None:
        yield _mitsuba(case, receiver.mitsuba)
    if receiver.own_rays is not None:
        yield _independent_rays(case, receiver.own_rays)


def _plain(proof: Proof) -> Group:
    plain = proof.plain_cast
    description = f"{number(plain.disagreements)} of {number(plain.casts)} first hits differ from those above"
    state = state_of(proof.criteria, "plain_cast_disagreements")
    return Group("tracer", "Plain ray cast by trimesh", (_rays(plain.rays),), f"lens.stl; {description}", state)


def _brep(case: Case[Proof], brep: BrepCast) -> Group:
    fates = brep.against_design.fates
    ends = "every ray has the same fate" if fates == 0 else f"{number(fates)} rays have another fate"
    description = f"lens.step; {quantity(brep.against_mesh.rms, 'mm', digits=2)} rms from the mesh; {ends}"
    names = ("brep_deviation_rms", "brep_flux_deviation", "brep_fate_disagreements")
    facts = (_rays(brep.rays), *_gaps(brep.against_design))
    return _tracer(case, "CAD kernel, face by face", facts, description, names)


def _mitsuba(case: Case[Proof], mitsuba: MitsubaCast) -> Group:
    relation = "within" if mitsuba.nmse_vs_design <= mitsuba.noise_floor_nmse else "above"
    floor = number(mitsuba.noise_floor_nmse, 2)
    description = f"lens.stl; NMSE {number(mitsuba.nmse_vs_design, 2)}, {relation} the {floor} of ray noise alone"
    kinds = ("nmse_vs_design", "deviation_rms", "flux_deviation", "fate_disagreement_flux")
    facts = (_rays(mitsuba.rays), *_gaps(mitsuba.against_design))
    title = f"Mitsuba {mitsuba.version}, flat facets"
    return _tracer(case, title, facts, description, [f"mitsuba_{kind}" for kind in kinds])


def _independent_rays(case: Case[Proof], independent: IndependentRays) -> Group:
    redrawn, expected = (
        Fact.share("", "", share).text for share in (independent.efficiency, independent.efficiency_design)
    )
    description = f"lens.stl; efficiency {redrawn}, the design’s light {expected}"
    if independent.nmse_less_noise is not None:
        less_noise = independent.nmse_less_noise
        description += f"; NMSE less noise {square(less_noise.value, less_noise.standard_error)}"
    names = ("own_rays_efficiency", "own_rays_nmse", *([] if case.number else ["own_rays_emission"]))
    return _tracer(case, "Independent rays of the LED", (_rays(independent.rays),), description, names)


def _rays(count: int) -> Fact:
    return Fact("rays", "Rays", count)


def _gaps(deviation: LandingDeviation) -> tuple[Fact, ...]:
    named = (("rms", "rms", deviation.rms), ("p99", "99 %", deviation.p99), ("largest", "largest", deviation.max))
    return tuple(Fact(key, label, value, "mm", digits=2) for key, label, value in named)
