"""Lenses for the geometry tests: plain shells with closed forms, and random freeforms."""

from typing import Any

import numpy as np
from presets import COARSE_SPLINES

from lensforge.cad.patch import Patch, fit_patch
from lensforge.cad.plan import Plan, make_plan
from lensforge.scene.lens import Lens
from lensforge.spec import BaseSection, parse_spec
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface
from lensforge.surfaces.surface import Surface

PAPER_SCALES = [(0.8, 2.45), (6.0, 13.7)]
ALL_LEVELS = (9, 25, 81, 289)


def random_surface(
    offset: float, relative: float, seed: int, levels: tuple[int, ...] = (9, 25), symmetry: str = "none"
) -> SrbfSurface:
    """Weights that fall with the width of their function, so that slopes stay alike from level to level."""
    basis = SrbfBasis(levels, 1.75, symmetry)
    noise = np.random.default_rng(seed).normal(size=basis.size)
    return SrbfSurface(basis, offset * relative * noise * basis.sigmas / basis.sigmas.max(), offset)


def make_lens(
    inner: float,
    outer: float,
    relative: float = 0.0,
    seed: int = 0,
    levels: tuple[int, ...] = (9, 25),
    symmetry: str = "none",
    base: dict[str, Any] | None = None,
) -> Lens:
    surfaces = [random_surface(h, relative, seed + k, levels, symmetry) for k, h in enumerate((inner, outer))]
    content = {
        "name": "test_lens",
        "source": {"kind": "square", "side_mm": 0.5},
        "lens": {"levels": levels, "inner": {"offset_mm": inner}, "outer": {"offset_mm": outer}, "symmetry": symmetry},
        "constraints": {
            "cavity_height_mm": inner / 2,
            "cavity_radius_mm": inner / 2,
            "min_thickness_mm": 0.1,
            "max_radius_mm": 2 * outer,
        },
        "target": {"kind": "flat_top", "distance_mm": 100.0, "receiver_mm": 100.0, "width_mm": 60.0},
        "base": base or {},
        "manufacture": {"required": False},  # room for a tool is what a test gives it
    }
    return Lens.double(*surfaces, parse_spec(content, "test"), seed, COARSE_SPLINES)


def plan_of(inner: Surface, outer: Surface, base: BaseSection | None = None, nodes: int | None = None) -> Plan[Patch]:
    """The plan of the body between splines of two surfaces, by default on a base of one inch."""
    return make_plan(fit_patch(inner, nodes), fit_patch(outer, nodes), base or BaseSection())


def exact_volume(inner: SrbfSurface, outer: SrbfSurface, base: BaseSection) -> float:
    """Volume of the body from the surfaces alone: integrals of rho^3/3 over the hemisphere and rho^2/2 over the rim."""
    node, weight = np.polynomial.legendre.leggauss(96)
    height = (node + 1.0) / 2.0
    weight = weight / 2.0
    azimuth = np.linspace(0.0, 2.0 * np.pi, 256, endpoint=False)
    z, phi = np.meshgrid(height, azimuth, indexing="ij")
    s = np.sqrt(1.0 - z**2)
    u = np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1).reshape(-1, 3)
    shell = (outer.radius(u) ** 3 - inner.radius(u) ** 3).reshape(z.shape).mean(axis=1) @ weight * 2.0 * np.pi / 3.0
    if base.kind == "none":
        return float(shell)
    rim = np.stack([np.cos(azimuth), np.sin(azimuth), 0.0 * azimuth], axis=-1)
    opening = np.pi * np.mean(inner.radius(rim) ** 2)
    return float(shell + base.height_mm * (np.pi * base.diameter_mm**2 / 4.0 - opening))


def off_grid_chart(count: int, seed: int = 1) -> np.ndarray:
    """Random points of the unit disc, half of them within 3 % of the rim or on it."""
    rng = np.random.default_rng(seed)
    radius = np.sqrt(rng.random(count))
    radius[: count // 2] = 0.97 + 0.03 * radius[: count // 2]
    radius[: count // 4] = 1.0
    turn = 2.0 * np.pi * rng.random(count)
    return radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
