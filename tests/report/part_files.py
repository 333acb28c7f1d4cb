"""Results that not every lens has, easy to recognise: stray light, and those of add-ons."""

import numpy as np
from addon_rows import addon_rows
from filled import filled
from result_folders import (
    MAKERS,
    PIXELS,
    STAGES,
    divided,
    light_images,
    make_folder,
    make_results,
)

from lensforge.proof.cast_results import Agreement, BrepCast, MitsubaCast
from lensforge.proof.proof_result import ReceiverStray, StrayFlux, StrayLight
from lensforge.scene.receiver_shapes import build_receiver


def make_receiver_stray(section, **changes):
    """The stray light on one receiver."""
    light = light_images(*build_receiver(section, PIXELS).grid.shape)
    content = {
        "name": section.name,
        "width": section.size[0],
        "height": section.size[1],
        "far_field": section.kind == "far_field",
        "flux": filled(StrayFlux, detected_direct=0.8475, too_dim=0.0, leaked=0.0),
        "balance_error": 0.0,
        "nmse_vs_sequential": 0.00325,
        "peak_of_mean": 0.085,
        "sequential": light["raw_map"],
        "direct": light["raw_map"],
        "stray": 0.02 * light["target_map"] + 0.1,
    }
    return filled(ReceiverStray, **{**content, **changes})


def make_stray(lens, **changes):
    """The stray light of ``lens``; ``changes``: of the record, or of the light on its first receiver."""
    first, *others = lens.spec.all_receivers
    of_first, of_record = divided(changes, ReceiverStray)
    content = {
        "inputs": {"lens": lens.sha256},
        "receivers": (make_receiver_stray(first, **of_first), *map(make_receiver_stray, others)),
    }
    return filled(StrayLight, **{**content, **of_record})


def verified():
    """What the proof holds where all referees were asked."""
    quantiles = np.linspace(1e-4, 0.1, 501)
    alike = filled(Agreement, rms=0.0015, flux=0.00005, fates=1, fates_flux=0.000375)
    return {
        "brep": filled(BrepCast, against_design=alike),
        "mitsuba": filled(
            MitsubaCast, version="3.9.1", against_design=alike, nmse_vs_design=0.0065, noise_floor_nmse=0.0085
        ),
        "gaps_step_mm": 0.1 * quantiles,
        "gaps_mitsuba_mm": 5.0 * quantiles,
    }


MAKERS |= {"stray": make_stray, **addon_rows("MAKERS")}
EXTRAS = ("stray", *addon_rows("MAKERS"))


def whole_results(**records):
    """All stages, all referees, stray light, and what add-ons make."""
    return make_results((*STAGES, *EXTRAS), **{"verify": verified(), **records})


def whole_folder(folder, **records):
    """The files of :func:`whole_results`."""
    return make_folder(folder, (*STAGES, *EXTRAS), **{"verify": verified(), **records})
