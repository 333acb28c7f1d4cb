"""What may go wrong, each by a stated amount of the size that shops know."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from lensforge.lens import Lens
from lensforge.tolerancing.amounts import Amounts
from lensforge.tolerancing.perturbed_surfaces import Displaced, with_form_error

Radius = Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, " n"]]

LOW_ORDER = 9  # functions over the hemisphere: errors as wide as astigmatism and coma


@dataclass(frozen=True)
class Perturbation:
    """One error: its name, amount and unit, and what it changes; a surface that is not named stays as designed."""

    name: str
    amount: float
    unit: str
    surfaces: dict[str, Radius] = field(default_factory=dict)
    source_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    index: float = 0.0


def perturbations(lens: Lens, amounts: Amounts, seed: int) -> list[Perturbation]:
    """Form errors of each face, the outer face moved against the inner one and the source, source, and index."""
    return [*_form(lens, amounts, seed), *_alignment(lens, amounts), *_source_and_index(amounts)]


def _form(lens: Lens, amounts: Amounts, seed: int) -> list[Perturbation]:
    found = []
    for number, name in enumerate(("inner", "outer")):
        surface = getattr(lens, name)
        for title, functions, rms in (
            ("low-order", LOW_ORDER, amounts.low_order_rms_mm),
            ("SRBF-scale", lens.spec.lens.levels[-1], amounts.fine_rms_mm),
        ):
            wrong = with_form_error(surface, functions, lens.spec.lens.sigma_c, rms, seed + number)
            found.append(Perturbation(f"{title} form error, {name}", 1e3 * rms, "um rms", {name: wrong.radius}))
    return found


def _alignment(lens: Lens, amounts: Amounts) -> list[Perturbation]:
    def moved(x: float = 0.0, y: float = 0.0, z: float = 0.0, tilt: float = 0.0) -> dict[str, Radius]:
        return {"outer": Displaced(lens.outer, (x, y, z), tilt).radius}

    decentre, gap, tilt = amounts.decentre_mm, amounts.gap_mm, amounts.tilt_rad
    return [
        Perturbation("decentre in x, outer against inner", 1e3 * decentre, "um", moved(x=decentre)),
        Perturbation("decentre in y, outer against inner", 1e3 * decentre, "um", moved(y=decentre)),
        Perturbation("tilt about x, outer against inner", 1e3 * tilt, "mrad", moved(tilt=tilt)),
        Perturbation("gap, outer against inner", 1e3 * gap, "um", moved(z=gap)),
        Perturbation("gap, outer against inner", -1e3 * gap, "um", moved(z=-gap)),
    ]


def _source_and_index(amounts: Amounts) -> list[Perturbation]:
    shift = amounts.source_mm
    axes = {"x": (shift, 0.0, 0.0), "y": (0.0, shift, 0.0), "z": (0.0, 0.0, shift)}
    found = [Perturbation(f"source shift in {axis}", 1e3 * shift, "um", source_mm=by) for axis, by in axes.items()]
    found.append(Perturbation("source shift in z", -1e3 * shift, "um", source_mm=(0.0, 0.0, -shift)))
    return found + [Perturbation("index", sign * amounts.index, "", index=sign * amounts.index) for sign in (1.0, -1.0)]
