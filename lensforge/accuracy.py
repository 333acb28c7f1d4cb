"""Accuracy presets in one table, so that every stage reads the same settings.

The rule, measured by ``lensforge tradeoff`` (docs/accuracy.md): the irradiance error of a preset's tables stays below a
hundredth of the noise of the rays that are traced with it. On the flat top, the cross and the pi it is 0.0014 of that
noise at most, so accuracy takes more rays: from one preset to the next the noise (NMSE) of the evaluation falls,
first to 1/13, then to less than 1/2.
"""

from dataclasses import dataclass

from lensforge.spec import Accuracy


@dataclass(frozen=True)
class Preset:
    """Settings of a preset.

    ``nodes_per_sigma``: table nodes across the narrowest SRBF's sigma at the apex, while designing;
    ``evaluate_nodes_per_sigma``: the same where the finished lens is evaluated and verified.
    ``design_rays``: rays of a gradient step. ``coarse_steps``, ``fine_steps``: gradient steps of every level but the
    last, and of the last. ``evaluate_rays``: rays that evaluate the finished lens. ``verify_rays``: rays of the
    independent ray cast.
    """

    nodes_per_sigma: float
    evaluate_nodes_per_sigma: float
    design_rays: int
    coarse_steps: int
    fine_steps: int
    evaluate_rays: int
    verify_rays: int


PRESETS: dict[Accuracy, Preset] = {
    "draft": Preset(2.5, 6.0, 2**14, 60, 120, 2**20, 2**14),
    "standard": Preset(3.4, 8.0, 2**16, 100, 300, 2**23, 2**16),
    "reference": Preset(5.0, 12.0, 2**18, 150, 600, 2**24, 2**17),
}
