"""Remedies of the criteria: each follows from the cause that the results show, not from the criterion that fails.

Rays that land elsewhere tell of the form; rays that land alike with another flux, of losses; rays that one of both
loses, of their fates.
"""

from dataclasses import dataclass

from lensforge.proof.cast_results import Agreement, FatePair

FINER_FACETS = "export with more --rings"
FINER = "export with a finer mesh: without --rings it is as fine as the light asks, with a larger --rings finer still"
_NAMED = 2  # pairs of fates in one line: the rest is in ``pairs``
_START = "light that starts there meets no cavity: move the source into it; if it stays, report"
_BY_DESIGN = {
    "backward": _START,
    "outside_cavity": _START,
    "not_converged": "the design found no intersection: design with a higher accuracy",
    "surfaces_intersect": "the surfaces cross: design again with a larger constraints.min_thickness_mm",
}
_BY_PART = {
    "opening": "the base cuts off light from below z = 0: raise the source, or lower the base or widen its opening",
    "no_hit": "rays slip past the part: it has a hole or is another lens; export again",
    "starts_inside": "the source is in the part's material: it is inside out or another lens; export again",
    "starts_outside": "the source is outside the part's cavity: it is another lens; export again",
}
_AT_A_LIMIT = f"this light is near the rim or the limit of total reflection: {FINER}"


@dataclass(frozen=True)
class Evidence:
    """Agreement of a file with the design, and its limits: rms deviation (mm), shares of flux for losses and fates.

    ``form``: remedy if its rays land elsewhere. ``fault``: the fault recognised in the file, if any; all else then
    follows from it. ``fine``: facets cannot be the cause: it is a STEP, or finer than needed.
    """

    agreement: Agreement
    deviation_mm: float
    flux: float
    fates: float
    form: str
    fault: str = ""
    fine: bool = False

    @property
    def lands_alike(self) -> bool:
        """True if the rays that land in both keep the limit of the deviation."""
        return self.agreement.compared > 0 and self.agreement.rms <= self.deviation_mm

    def of_deviation(self) -> str:
        """Remedy of rays that land elsewhere."""
        if self.fault:
            return self.fault
        if self.agreement.compared == 0:
            return f"no ray reaches the receiver in both: {self.of_fates()}"
        return self.form

    def of_flux(self) -> str:
        """Remedy of rays with another flux: of the form only if they land elsewhere, too."""
        if self.fault or not self.lands_alike:
            return self.of_deviation()
        return (
            "the rays arrive where they should, so the mesh is right, but their losses at the surfaces differ: is the "
            "index that of the design? evaluate and verify again; if it stays, please report it"
        )

    def of_fates(self) -> str:
        """Remedy of rays that land in only one of both: the largest pairs of fates, and advice on the first.

        Near the rim or a limit angle any error of form decides a fate: then it is that of the form.
        """
        pairs = self.agreement.pairs
        if self.fault or not pairs:
            return self.fault or self.form
        named = ", ".join(_fates_phrase(pair) for pair in pairs[:_NAMED])
        advice = _BY_PART.get(pairs[0].part) or _BY_DESIGN.get(pairs[0].design)
        if advice is None:
            advice = _AT_A_LIMIT if self.lands_alike and not self.fine else self.form
        return f"{named}; {advice}"

    def of_pixels(self) -> str:
        """Remedy of another pattern by the same rays: that of the first to fail of form, fates and losses."""
        if self.fault or not self.lands_alike:
            return self.of_deviation()
        if self.agreement.fates_flux > self.fates:
            return self.of_fates()
        if self.agreement.flux > self.flux:
            return self.of_flux()
        return (
            self.form
            if self.fine
            else f"the ray displacement is within its limit, but rays cross pixel borders: {FINER}"
        )


def form_of_mesh(open_edges: int, step_lands_alike: bool | None, mismatch: str = "", *, fine: bool = False) -> str:
    """Remedy of a mesh whose rays land elsewhere; ``step_lands_alike``: whether those of the STEP do, None: not cast.

    ``mismatch``: difference of its size from the export, as a sentence; "" if they agree. ``fine``: its facets are not
    the cause.
    """
    if open_edges > 0:
        return "export again: the mesh is not closed"
    if mismatch:
        return mismatch
    if step_lands_alike is False:
        return "lens.step displaces its rays, too, so the mesh is not the cause: the files are another lens; export"
    if fine:
        return f"{FINER_FACETS}; if it stays, a face of lens.stl lies elsewhere, or it has a void"
    if step_lands_alike is None:
        return f"{FINER}; if it stays, the file is not the lens of lens.json"
    return f"lens.step is right, its rays land where the design's do; the facets of lens.stl are too coarse: {FINER}"


def form_of_step(same_form: bool) -> str:
    """Remedy of a STEP file whose rays land elsewhere; ``same_form``: its faces are known to lie on the design's."""
    if same_form:
        return "lens.step is this lens, but its normals turn light too far: export again, as near as the light asks"
    return "export again; if it stays, lens.step is not the lens of lens.json"


def _fates_phrase(pair: FatePair) -> str:
    return f"{pair.flux:.2%} of the flux: design {_spaced(pair.design)}, part {_spaced(pair.part)}"


def _spaced(fate: str) -> str:
    return fate.replace("_", " ")
