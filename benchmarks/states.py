"""Lenses in states that no search has seen: a zoom at stops between its own, and a spot from cold to hot.

    python benchmarks/states.py zoom examples/zoom_torch.toml [--lens LENS.json] [--stops 7]
    python benchmarks/states.py heat examples/hot_and_cold.toml [--material PMMA]

``zoom``: intensity on the axis, full width at half of it, and the largest rise outwards over the peak, at each stop.
``heat``: middle of the width at half maximum in the plane C 0 - C 180, and efficiency, in each state. Another material
than that of the spec has the law of PMMA: -1.1e-4/K of index and 7e-5/K of length. All rays are the same.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

import lensforge as lf
from lensforge.search.travel import travelled

_OF_PMMA = {"lens.index_per_k": -1.1e-4, "lens.expansion_per_k": 7e-5}
RAYS = 2**20


def lens_of(options: argparse.Namespace, **changes: object) -> lf.Lens:
    """The lens that is given, or a draft of the spec."""
    if options.lens is not None:
        return lf.load_lens(options.lens)
    return lf.design(lf.load_spec(options.spec).replace(changes), accuracy="draft").lens


def profile(lens: lf.Lens) -> tuple[np.ndarray, np.ndarray]:
    """Angles (degrees), negative in C 180, and intensities (cd) in the plane C 0 - C 180."""
    measured = lf.photometry(lens, rays=RAYS)
    sides = [measured.candela[int(np.argmin(np.abs(measured.c_deg - plane)))] for plane in (0.0, 180.0)]
    return np.r_[-measured.gamma_deg[:0:-1], measured.gamma_deg], np.r_[sides[1][:0:-1], sides[0]]


def edges(angles: np.ndarray, light: np.ndarray, level: float) -> tuple[float, float]:
    """Outermost angles (degrees) at which the light is ``level``, linear between the nodes."""
    (above,) = np.nonzero(light >= level)
    first = slice(above[0] - 1, above[0] + 1)
    last = slice(above[-1], above[-1] + 2)
    return (
        float(np.interp(level, light[first], angles[first])),
        float(np.interp(level, light[last][::-1], angles[last][::-1])),
    )


def zoom_rows(lens: lf.Lens, stops: int) -> Iterator[str]:
    """The light at stops on the whole travel between the first two states."""
    first, last, *_ = lens.by_state.values()
    for share in np.linspace(0.0, 1.0, stops):
        led = travelled(first.spec.source, last.spec.source, float(share))
        angles, light = profile(replace(first, spec=first.spec.changed(source=led)))
        axis = float(light[angles == 0.0][0])
        low, high = edges(angles, light, 0.5 * axis)
        outwards = light[angles >= 0.0]
        rise = float(np.maximum(outwards - np.minimum.accumulate(outwards), 0.0).max() / light.max())
        yield f"| {led.position_mm[2]:.2f} | {axis:.4g} | {high - low:.1f} | {rise:.3f} |"


def heat_rows(lens: lf.Lens) -> Iterator[str]:
    """The middle of the beam and its efficiency in each state."""
    for name, state in lens.by_state.items():
        angles, light = profile(state)
        low, high = edges(angles, light, 0.5 * float(light.max()))
        efficiency = lf.evaluate(state, rays=RAYS).efficiency.value
        yield f"| {lens.spec.lens.material} | {name} | {0.5 * (low + high):.3f} | {efficiency:.4f} |"


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("zoom", "heat"))
    parser.add_argument("spec")
    parser.add_argument("--lens")
    parser.add_argument("--stops", type=int, default=7)
    parser.add_argument("--material")
    options = parser.parse_args()
    changes = {} if options.material is None else {"lens.material": options.material, **_OF_PMMA}
    lens = lens_of(options, **changes)
    rows = zoom_rows(lens, options.stops) if options.what == "zoom" else heat_rows(lens)
    for row in rows:
        print(row, flush=True)


if __name__ == "__main__":
    main()
