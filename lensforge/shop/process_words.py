"""Words of each process by which a part is made."""

from typing import NamedTuple

from lensforge.spec import Spec
from lensforge.spec.part_section import Process


class ProcessWords(NamedTuple):
    """Words of a process: what has edges at a cavity, what edges and optical faces must be without, what is left."""

    inner: str
    burr: str
    traces: str
    left: str


_ON_OPTICS = "marks of gate, ejector or parting line"
_OF_TOOLS = "what the tools leave of the inserts"
_WORDS: dict[Process, ProcessWords] = {
    "milled": ProcessWords("the cavity", "burr", "marks", "what the mill leaves"),
    "turned": ProcessWords("the cavity", "burr", "marks", "what the turning tool leaves"),
    "moulded": ProcessWords("the mould’s core", "flash", _ON_OPTICS, _OF_TOOLS),
    "printed": ProcessWords("the cavity", "rests of supports", "layers or marks of supports", ""),
}


def words_of(spec: Spec) -> ProcessWords:
    """The words of the process by which the part of ``spec`` is made."""
    assert spec.manufacture.process is not None  # it is derived
    return _WORDS[spec.manufacture.process]
