"""Checkpoint of a search: the whole state on disk, so that a resumed design ends with the same bits."""

import hashlib
import pickle
from io import BytesIO
from pathlib import Path
from typing import Any

import torch

from lensforge.errors import InputError
from lensforge.files import replacing
from lensforge.lens import Lens
from lensforge.spec import Spec
from lensforge.spec.files import input_hashes

_ANEW = "delete it, or start anew without resume"


def fingerprint(spec: Spec, seed: int, accuracy: str, start: Lens | None, device: torch.device | None) -> str:
    """Digest of what a search depends on: another spec, seed, preset, start or device must not resume from it."""
    searched = spec.model_dump_json(exclude={"evaluate", "base", "manufacture"})
    files = input_hashes(spec)
    text = f"{files}|{searched}|{spec.manufacture.make}|{seed}|{accuracy}|{start.sha256 if start else None}|{device}"
    return hashlib.sha256(text.encode()).hexdigest()


def save_checkpoint(path: Path, key: str, state: dict[str, Any]) -> None:
    """Write ``state`` (tensors, numbers, lists) beside ``path`` and rename."""
    content = BytesIO()  # torch's own writer hides a full disk behind an error of its own
    torch.save({"key": key, "state": state}, content)
    with replacing(path) as temporary:
        temporary.write_bytes(content.getbuffer())


def load_checkpoint(path: Path, key: str) -> dict[str, Any]:
    """Read a checkpoint of this very design. Raises :class:`InputError` for none, a damaged one, or another's."""
    try:
        content = torch.load(path, weights_only=True)
    except FileNotFoundError:
        raise InputError(f"{path}: no checkpoint to resume from; start anew without resume") from None
    except (OSError, RuntimeError, EOFError, ValueError, KeyError, pickle.UnpicklingError) as error:
        raise InputError(f"{path}: damaged checkpoint ({type(error).__name__}); {_ANEW}") from None
    if not isinstance(content, dict) or not isinstance(content.get("state"), dict):
        raise InputError(f"{path}: no checkpoint of a search; {_ANEW}")
    if content.get("key") != key:
        raise InputError(f"{path}: belongs to another spec, seed, accuracy, start or device; {_ANEW}")
    state: dict[str, Any] = content["state"]
    return state
