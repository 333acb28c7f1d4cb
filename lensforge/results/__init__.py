"""What came out, is it good, and how is it kept? Records, facts, criteria, files, plots, and child processes.

- ``record.Record``: a result: frozen, checked, written as JSON and npz
- ``stage_result.StageResult``: the result of a stage
- ``registered_kinds.OfSeveralKinds``: the base of records and sections of several kinds
- ``record.Metric``: a value with its standard error
- ``fact.Fact``: the one judged value: limit, state, label, note and remedy; page, screen and JSON show it
- ``figure.Figure``, ``figure.Criterion``: what is told of a field and what judges it, declared there
- ``case.Case``: a result with one LED and on one receiver, which tells its titles, criteria and files
- ``numerals.quantity``: the one formatter of numbers
- ``estimates.debiased_minimum``: figures of light without the noise of its rays, and their standard errors
- ``criteria.at_most``: the criterion that a value keeps its limit, a ``Fact``, too
- ``verdict.Verdict``: the judgement on light, files and cutting
- ``files.replacing``: a file that is written whole or not at all
- ``text_table.TextTable``: the one reader of tables in text files
- ``sandbox.work_in_child``: foreign files, read in a child process
- ``child_pool.child_pool``: functions called in child processes
- ``cluster.connected``: work on many machines
"""

from lensforge.results.conditions import Conditions
from lensforge.results.fact import Fact, FactState, Group
from lensforge.results.record import (
    Array,
    BodySize,
    Box,
    Count,
    Extent,
    Flag,
    Given,
    Image,
    InFile,
    Irradiance,
    Metric,
    NotNegative,
    Number,
    Point,
    Positive,
    Record,
    Sense,
    Sha256,
    Share,
    State,
    Text,
    stated,
)
from lensforge.results.stage_result import ResultByLed, SimulatedResult, StageResult

__all__ = [
    "Array",
    "BodySize",
    "Box",
    "Conditions",
    "Count",
    "Extent",
    "Fact",
    "FactState",
    "Flag",
    "Given",
    "Group",
    "Image",
    "InFile",
    "Irradiance",
    "Metric",
    "NotNegative",
    "Number",
    "Point",
    "Positive",
    "Record",
    "ResultByLed",
    "Sense",
    "Sha256",
    "Share",
    "SimulatedResult",
    "StageResult",
    "State",
    "Text",
    "stated",
]
