"""What did the machined part become, and how is it cut again? Photographs, points on faces, a second cut.

- ``measure_verbs``: the verbs ``compare``, ``correct`` and ``infer``
- ``measure_stages``: their stages of a result folder, and their commands
- ``measurement_result``: their records
- ``measured_facts``, ``measured_section``: what screen and page show of them
- ``photo_comparison``: a photograph and the simulated light
- ``target_corners``: the target in a photograph
- ``image_similarity``: likeness of two pictures
- ``measured_points``: points of the files of one part or several, on one face
- ``nominal_face``: the face that they are measured against
- ``registration``: the motion that brings them onto the design
- ``first_cut``: what they say of the face that was cut
- ``several_parts``, ``part_scatter``: what several parts have in common, and how they scatter about it
- ``capability``: Cp and Cpk; ``part_series``: the records of these
- ``areal_filter``: waves that they can show
- ``measured_surface``: form deviation, and the light of the lens with it
- ``correction``: the corrected face
- ``inference``: errors of a made lens from pictures of its light with the LED moved
- ``inference_result``: their record
- ``form_unknowns``: what may differ from the design
- ``picture_model``: pictures of a lens with such errors, and their slopes
- ``form_fit``: the errors that explain the pictures best, and their standard errors
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from lensforge.addon import Addon

if TYPE_CHECKING:
    import click


def _names() -> Mapping[str, object]:
    from lensforge.addons.measure.inference_result import Inference
    from lensforge.addons.measure.measure_verbs import compare, correct, infer
    from lensforge.addons.measure.measurement_result import Correction, PhotoComparison, SurfaceComparison

    public = (Correction, Inference, PhotoComparison, SurfaceComparison, compare, correct, infer)
    return {named.__name__: named for named in public}


def _commands() -> "Sequence[click.Command]":
    from lensforge.addons.measure.measure_stages import COMMANDS

    return COMMANDS


def _records() -> object:
    from lensforge.addons.measure import measured_facts

    return measured_facts


def _pages() -> object:
    from lensforge.addons.measure import measured_section

    return measured_section


ADDON = Addon("measure", _names, _commands, "The shop and the machined part", _records, _pages)
