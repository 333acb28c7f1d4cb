"""Small lenses, directions and specs that many tests start from."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import torch

from lensforge.optics.face_roles import DOUBLE
from lensforge.spec import Spec, parse_spec
from lensforge.spec.tolerances_section import PartTolerances, amounts_of
from lensforge.surfaces.bicubic_table import TableGrid, tabulate
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

NO_TOLERANCES = dict.fromkeys(amounts_of("standard"), 0)
# Where torch may trace: everywhere on the CPU, on a GPU where there is one.
DEVICES = [
    "cpu",
    pytest.param("cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")),
]


def hemisphere_directions(count: int, seed: int = 0) -> np.ndarray:
    """Uniform random unit directions with z > 0."""
    rng = np.random.default_rng(seed)
    z, azimuth = rng.random(count), 2.0 * np.pi * rng.random(count)
    sine = np.sqrt(1.0 - z * z)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), z], axis=1)


def random_surface(
    seed: int, offset_mm: float, roughness: float = 0.02, levels: tuple[int, ...] = (25, 81), symmetry: str = "none"
) -> SrbfSurface:
    """A surface whose weights are normal with a standard deviation of ``roughness`` times its offset."""
    basis = SrbfBasis(levels, 1.75, symmetry)
    weights = np.random.default_rng(seed).normal(size=basis.size) * roughness * offset_mm
    return SrbfSurface(basis, weights, offset_mm)


def sphere(radius_mm: float) -> SrbfSurface:
    """A hemisphere about the origin."""
    return SrbfSurface(SrbfBasis((4,), 1.75), np.zeros(4), radius_mm)


def weight_matrix(grid: TableGrid, basis: SrbfBasis) -> np.ndarray:
    """Table coefficients (flattened) for each unit weight, every function sampled on the whole table."""
    return grid.coefficients(basis.evaluate(grid.sample_directions()))


def table_of(surface: SrbfSurface, grid: TableGrid) -> torch.Tensor:
    """The surface's table as the tracer takes it."""
    return torch.from_numpy(tabulate(grid, surface))


def small_spec(**changes: Any) -> Spec:
    """A flat top that a few steps of a few rays can begin to make; ``section__field=value`` changes a field.

    It need not be made: so few steps keep no limits of a tool, nor do faces that a test has written down.
    """
    content: dict[str, Any] = {
        "name": "small",
        "source": {"kind": "square", "side_mm": 1.0},
        "lens": {"levels": [9, 25], "inner": {"offset_mm": 3.0}, "outer": {"offset_mm": 6.0}, "symmetry": "none"},
        "constraints": {
            "cavity_height_mm": 0.5,
            "cavity_radius_mm": 1.0,
            "min_thickness_mm": 1.0,
            "max_radius_mm": 7.0,
        },
        "target": {
            "kind": "flat_top",
            "width_mm": 160.0,
            "distance_mm": 100.0,
            "receiver_mm": 200.0,
            "uniform_mm": 100.0,
        },
        "optimise": {"steps_per_level": [4, 4], "rays": 1024, "pixels": 16},
        "evaluate": {"rays": 4096, "pixels": 16},
        "base": {"diameter_mm": 16.0},
        "manufacture": {"required": False},
    }
    for key, value in changes.items():
        *holders, field = key.split("__")
        table = content
        for name in holders:
            table[name] = table = dict(table.get(name, {}))
        table[field] = value
    return parse_spec(content, "small")


def tolerance_changes(amounts: Mapping[str, Any], joint: str = "__") -> dict[str, Any]:
    """Changes of a spec that give tolerances by the names of their factors, such as ``inner_form_um``."""
    changes = {}
    for name, amount in amounts.items():
        face, _, field = ("outer", "_", name) if name == "gap_mm" else name.partition("_")
        changes[joint.join(("lens", face, field) if face in DOUBLE else ("tolerances", name))] = amount
    return changes


def part_tolerances(**amounts: Any) -> PartTolerances:
    """Tolerances by the names of their factors; those left out are 0."""
    return small_spec(**tolerance_changes({**NO_TOLERANCES, **amounts})).part_tolerances
