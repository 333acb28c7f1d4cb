"""The independent tracers of the exported part: a row for each, and the distances of its rays from the design's."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, PercentFormatter

from lensforge.proof.proof_result import (
    Agreement,
    BrepCast,
    IndependentRays,
    MitsubaCast,
    PlainCast,
    Proof,
    ReceiverProof,
)
from lensforge.report.figure_style import BLUE, GREEN, INK, ORANGE, WIDE, in_report_style, new_figure
from lensforge.report.headline import criteria_state
from lensforge.report.numerals import number, percent
from lensforge.report.pictures import PagePicture, picture
from lensforge.report.shown_receivers import numbered, suffix
from lensforge.results import Metric
from lensforge.runs.results import Results

_COLOURS = (BLUE, GREEN, ORANGE)
_LEAST_MM = 1e-5  # 10 nm: smaller distances have no optical meaning


@dataclass(frozen=True)
class RefereeRow:
    """One referee: its file and rays, the distances (mm) between its landings and the design's, and its finding."""

    name: str
    file: str
    rays: str
    rms_mm: str
    p99_mm: str
    largest_mm: str
    says: str
    state: str


def referee_rows(results: Results) -> list[RefereeRow]:
    """A row for every referee that has run, on each receiver; none where the part has not been verified."""
    proof = results.find(Proof)
    if proof is None:
        return []
    rows = [row for index in range(len(proof.receivers)) for row in _rows(proof, index)]
    return [rows[0], _plain(proof, proof.plain_cast), *rows[1:]]


def _rows(proof: Proof, index: int) -> Iterator[RefereeRow]:
    receiver = proof.receivers[index]
    gap = receiver.deviation_mm
    rms, p99, largest = (number(value, 2) for value in (gap.rms, gap.p99, gap.max))
    floor = f"NMSE {number(receiver.nmse_vs_design, 2)}, ray noise alone {number(receiver.noise_floor_nmse, 2)}"
    yield RefereeRow(
        f"Mesh with smooth normals{suffix(proof.receivers, index)}",
        "lens.stl",
        number(proof.rays),
        rms,
        p99,
        largest,
        floor,
        _state(proof, index, "deviation_rms", "nmse_same_rays", "nmse_vs_design", "flux_deviation"),
    )
    if receiver.brep is not None:
        yield _brep(proof, receiver.brep, index)
    if receiver.mitsuba is not None:
        yield _mitsuba(proof, receiver.mitsuba, index)
    if receiver.own_rays is not None:
        yield _own_rays(proof, receiver.own_rays, index)


def _state(proof: Proof, index: int, *names: str) -> str:
    """State of the criteria of one receiver; those of all but the first carry its name."""
    start = f"{proof.receivers[index].name}: " if index else ""
    return criteria_state(proof.criteria, *(f"{start}{name}" for name in names))


def _plain(proof: Proof, plain: PlainCast) -> RefereeRow:
    says = f"{number(plain.disagreements)} of {number(plain.casts)} first hits differ from those above"
    state = criteria_state(proof.criteria, "plain_cast_disagreements")
    return RefereeRow("Plain ray cast by trimesh", "lens.stl", number(plain.rays), "", "", "", says, state)


def _brep(proof: Proof, brep: BrepCast, index: int) -> RefereeRow:
    says = f"{number(brep.against_mesh.rms, 2)} mm rms from the mesh; {_fates(brep.against_design)}"
    state = _state(proof, index, "brep_deviation_rms", "brep_flux_deviation", "brep_fate_disagreements")
    name = f"CAD kernel, face by face{suffix(proof.receivers, index)}"
    return RefereeRow(name, "lens.step", number(brep.rays), *_gaps(brep.against_design), says, state)


def _mitsuba(proof: Proof, mitsuba: MitsubaCast, index: int) -> RefereeRow:
    relation = "within" if mitsuba.nmse_vs_design <= mitsuba.noise_floor_nmse else "above"
    floor = number(mitsuba.noise_floor_nmse, 2)
    says = f"NMSE {number(mitsuba.nmse_vs_design, 2)}, {relation} the {floor} of ray noise alone"
    names = ("nmse_vs_design", "deviation_rms", "flux_deviation", "fate_disagreement_flux")
    state = _state(proof, index, *(f"mitsuba_{name}" for name in names))
    name = f"Mitsuba {mitsuba.version}, flat facets{suffix(proof.receivers, index)}"
    return RefereeRow(name, "lens.stl", number(mitsuba.rays), *_gaps(mitsuba.against_design), says, state)


def _own_rays(proof: Proof, own: IndependentRays, index: int) -> RefereeRow:
    says = f"efficiency {_percent(own.efficiency)}, the design\u2019s light {_percent(own.efficiency_design)}"
    if own.nmse_less_noise is not None:
        error = number(own.nmse_less_noise.standard_error, 2)
        says += f"; NMSE less noise {number(own.nmse_less_noise.value, 2)} \u00b1 {error}"
    state = _state(proof, index, "own_rays_efficiency", "own_rays_nmse", *(["own_rays_emission"] if index == 0 else []))
    name = f"Freshly drawn rays of the LED{suffix(proof.receivers, index)}"
    return RefereeRow(name, "lens.stl", number(own.rays), "", "", "", says, state)


def _percent(share: Metric) -> str:
    error = "" if share.standard_error is None else f" \u00b1 {percent(share.standard_error, 2)}"
    return f"{percent(share.value, 2)}{error}"


def _gaps(agreement: Agreement) -> tuple[str, str, str]:
    return number(agreement.rms, 2), number(agreement.p99, 2), number(agreement.max, 2)


def _fates(agreement: Agreement) -> str:
    return (
        "every ray has the same fate" if agreement.fates == 0 else f"{number(agreement.fates)} rays have another fate"
    )


def gap_pictures(results: Results) -> list[PagePicture]:
    """Distances between each referee's landings and the design's, as distributions, for each receiver."""
    proof = results.find(Proof)
    if proof is None:
        return []
    caption = "Share of the rays that land within this distance of the design's landing."
    return [
        picture(
            numbered("gaps", index),
            gap_figure(_quantiles(receiver), receiver.deviation_limit_mm, far_field=receiver.far_field),
            f"Ray by ray{suffix(proof.receivers, index)}",
            caption,
        )
        for index, receiver in enumerate(proof.receivers)
    ]


def _quantiles(receiver: ReceiverProof) -> dict[str, Float[np.ndarray, " q"]]:
    """Distances of the referees that have run, by name."""
    named = {
        "exported mesh": receiver.gaps_mesh_mm,
        "STEP file": receiver.gaps_step_mm,
        "mesh, by Mitsuba": receiver.gaps_mitsuba_mm,
    }
    return {name: quantiles for name, quantiles in named.items() if quantiles is not None}


@in_report_style
def gap_figure(
    gaps_mm: Mapping[str, Float[np.ndarray, " q"]], limit_mm: float | None, *, far_field: bool = False
) -> Figure:
    """Cumulative share of the rays over the gap; ``gaps_mm``: by name of the referee, quantiles evenly from 0 to 1.

    ``limit_mm``: the largest rms gap allowed for the exported mesh, dashed. Gaps of directions are those at 1 m.
    """
    figure, axes = new_figure(WIDE, 3.1)
    for (name, quantiles), colour in zip(gaps_mm.items(), _COLOURS, strict=False):
        share = np.linspace(0.0, 1.0, len(quantiles))
        axes.plot(np.maximum(quantiles, _LEAST_MM), share, color=colour, label=name)
    if limit_mm is not None:
        axes.axvline(limit_mm, color=INK, linewidth=0.9, linestyle=(0, (4, 3)), label="limit of the mesh's rms")
    label = "distance from the design's landing (mm{})".format(" at 1 m" if far_field else "")
    axes.set(xscale="log", xlabel=label, ylabel="share of the rays", ylim=(0, 1.02))
    low = min(float(quantiles[len(quantiles) // 50]) for quantiles in gaps_mm.values())
    axes.set_xlim(left=max(low, _LEAST_MM))
    axes.xaxis.set_major_locator(LogLocator(numticks=8))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0, symbol=" %"))
    axes.grid(True)
    figure.legend(loc="outside upper left", ncols=2, handlelength=1.3, columnspacing=1.0)
    return figure
