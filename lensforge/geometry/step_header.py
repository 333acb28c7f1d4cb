"""Header of a STEP file: who made it, for whom, and of which date.

The date is given, never the clock's, so that the same lens has the same bytes.
"""

from dataclasses import dataclass
from typing import Any

from lensforge.version import __version__


@dataclass(frozen=True)
class StepHeader:
    """Texts of the header; ``date`` as 2026-01-31, None where none is given: the time stamp is then an empty string."""

    author: str = ""
    organisation: str = ""
    date: str | None = None
    description: str = ""


def sign(model: Any, product: str, header: StepHeader) -> None:
    """Fill in the header of a STEP ``model``: product, time stamp, author, organisation, program and version."""
    from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
    from OCP.TCollection import TCollection_HAsciiString

    def text(words: str) -> Any:
        return TCollection_HAsciiString(step_text(words))

    made = APIHeaderSection_MakeHeader(model)
    made.SetName(text(product))
    made.SetTimeStamp(text("" if header.date is None else f"{header.date}T00:00:00"))
    made.SetOriginatingSystem(text(f"lensforge {__version__}"))
    made.SetAuthorValue(1, text(header.author))
    made.SetOrganizationValue(1, text(header.organisation))
    made.SetDescriptionValue(1, text(header.description or product))


def step_text(words: str) -> str:
    """``words`` as ISO 10303-21 writes them: ASCII, all other characters by their code; the kernel doubles quotes."""
    return "".join(_coded(character) for character in words)


def _coded(character: str) -> str:
    if character.isascii() and character != "\\":
        return character
    code = ord(character)
    return f"\\X2\\{code:04X}\\X0\\" if code < 0x10000 else f"\\X4\\{code:08X}\\X0\\"
