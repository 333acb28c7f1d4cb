"""The medium of the lens body, as rays meet it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Medium:
    """Refractive index, and absorption (1/mm) by the law of Beer and Lambert, for rays without their own."""

    refractive_index: float
    absorption_per_mm: float = 0.0
