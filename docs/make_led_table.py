"""Write the table of LED packages in docs/leds.md: the area that emits, and the smallest lens for a beam.

python docs/make_led_table.py
"""

import re
from collections.abc import Iterator
from math import cos, pi, radians, sqrt
from pathlib import Path

import numpy as np

from lensforge.optics.fundamental_limits import etendue_from_ball
from lensforge.scene.possible_light import EtendueCurve
from lensforge.sources.build_source import build_source
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.led_packages import LedPackage, led_packages

PAGE = Path(__file__).parent / "leds.md"
BEAMS_DEG = (10.0, 20.0, 40.0, 80.0)  # full widths of even round beams
SHARE = 0.9  # of the light, the brightest first
_RAYS = 2**14
_SEED = 0
_TABLE = re.compile(r"(?<=<!-- packages -->\n).*(?=<!-- end of packages -->)", re.DOTALL)


def smallest_radii_mm(package: LedPackage) -> list[float]:
    """Radius (mm) of the smallest lens for each beam: of a ball from which the étendue of the light fits into it.

    It is no smaller than the LED.
    """
    section = EmitterSection.kinds[package.shape](**package.source)
    source = build_source(section, None)
    curve = EtendueCurve.of_source(source, source.sample(_RAYS, _SEED), _SEED)
    etendue_mm2_sr = float(np.interp(SHARE, curve.share, curve.etendue_mm2_sr))
    solid_angles_sr = [2.0 * pi * (1.0 - cos(radians(0.5 * beam_deg))) for beam_deg in BEAMS_DEG]
    radii_mm = [sqrt(etendue_mm2_sr / etendue_from_ball(1.0, solid_angle_sr)) for solid_angle_sr in solid_angles_sr]
    return [max(radius_mm, section.extent_mm or 0.0) for radius_mm in radii_mm]


def _digits(length_mm: float) -> str:
    return f"{length_mm:.2g}" if length_mm < 10.0 else f"{length_mm:.0f}"


def rows() -> Iterator[str]:
    """Lines of the table in Markdown."""
    yield f"| package | emits, flux | {' | '.join(f'{beam_deg:g}°' for beam_deg in BEAMS_DEG)} |"
    yield "|---|---|" + "---|" * len(BEAMS_DEG)
    for name, package in led_packages().items():
        yield f"| {name} | {package.phrase} | {' | '.join(map(_digits, smallest_radii_mm(package)))} |"


def filled(page: str) -> str:
    """The text of the page with the table made anew."""
    return _TABLE.sub("\n" + "\n".join(rows()) + "\n\n", page)


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
