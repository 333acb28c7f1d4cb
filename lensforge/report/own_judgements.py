"""Judgements in the file of a record held against those that its other entries and the lens make.

A file that somebody edited may state right hashes of wrong content: neither a value nor a limit nor a state can be
changed alone. What follows from a record alone it compares as it is read.
"""

from pathlib import Path

from lensforge.errors import InputError
from lensforge.results import StageResult
from lensforge.results.stage_result import require_same_judgements
from lensforge.scene.lens import Lens


def require_own_judgements(result: StageResult, lens: Lens, path: Path) -> None:
    """Raise :class:`InputError` where judgements in the file at ``path`` are not those that its figures make.

    Those on another lens count nowhere, and are not judged by the limits of this one.
    """
    if result.inputs.get("lens") != lens.sha256:
        return
    try:
        for case in result.cases():
            for field, made in case.result.judgements_on(lens.of_state(case.led)).items():
                require_same_judgements(field, getattr(case.result, field), made)
    except (InputError, ValueError) as error:  # of a state that the lens has not, or of other figures
        raise InputError(f"{path}: {error}; {type(result).rebuild_command()}") from None
