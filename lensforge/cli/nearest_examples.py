"""The shipped specs that are nearest to a new spec: of its kind of lens and light, plain, and of a similar size."""

import tomllib
from collections.abc import Mapping
from math import atan, degrees, log
from typing import Any

from lensforge.errors import InputError
from lensforge.spec.lens_section import LensShape
from lensforge.spec.shipped_specs import shipped_folder

_MOST = 4
_PLAIN = frozenset(
    {"name", "source", "lens", "constraints", "target", "receivers"}
    | {"optimise", "evaluate", "base", "manufacture", "tolerances"}
)
_WIDTHS = ("width", "diameter", "length", "outer_diameter", "fwhm")


def nearest_examples(kind: str, content: Mapping[str, Any]) -> list[str]:
    """Names of a few shipped specs with this ``kind`` of lens, the nearest to the light of ``content`` first."""
    try:
        paths = sorted(shipped_folder().glob("*.toml"))
    except InputError:  # an installation without any
        return []
    shipped = {path.stem: tomllib.loads(path.read_text(encoding="utf-8")) for path in paths}
    alike = [name for name, spec in shipped.items() if spec.get("lens", {}).get("kind", LensShape.usual_kind) == kind]
    return sorted(alike, key=lambda name: _distance(shipped[name], content))[:_MOST]


def _distance(shipped: Mapping[str, Any], content: Mapping[str, Any]) -> tuple[bool, int, float, int]:
    """Distance of two specs: another light, what else is in the ``shipped`` one, its size; of equals the shortest."""
    beyond = len(shipped.keys() - _PLAIN)
    width_deg = _width_deg(shipped)
    wanted_deg = _width_deg(content)
    apart = abs(log(width_deg / wanted_deg)) if width_deg and wanted_deg else 0.0
    return _light(shipped) != _light(content), beyond, apart, len(str(shipped))


def _light(content: Mapping[str, Any]) -> tuple[object, ...]:
    """Kinds of a spec's target and of its receiver, and whether that is tilted."""
    receiver = content.get("receivers", [{}])[0]
    return _target(content).get("kind"), receiver.get("kind"), "tilt_deg" in receiver


def _target(content: Mapping[str, Any]) -> Mapping[str, Any]:
    receiver = content.get("receivers", [{}])[0]
    target: Mapping[str, Any] = receiver.get("targets", [content.get("target", {})])[0]
    return target


def _width_deg(content: Mapping[str, Any]) -> float | None:
    """Full angle of the first target's width from the LED; None if its fields do not tell."""
    target = _target(content)
    for name in _WIDTHS:
        angle = target.get(f"{name}_deg")
        if angle is not None:
            return float(angle[0] if isinstance(angle, list) else angle)
        width_mm = target.get(f"{name}_mm")
        away_mm = target.get("distance_mm")
        if width_mm is not None and away_mm is not None:
            return degrees(2.0 * atan(width_mm / away_mm / 2.0))
    return None
