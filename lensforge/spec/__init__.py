"""The specification of a design, read from TOML: validated once, immutable, every length in mm."""

from lensforge.spec.design import Spec, load_spec, parse_spec
from lensforge.spec.lens import LensSection
from lensforge.spec.part import BaseSection, ManufactureSection, Tool
from lensforge.spec.search import Accuracy, ConstraintsSection, EvaluateSection, OptimiseSection
from lensforge.spec.target import ArrayTarget, CrossTarget, FlatTopTarget, ImageTarget, Target, TextTarget

__all__ = [
    "Accuracy",
    "ArrayTarget",
    "BaseSection",
    "ConstraintsSection",
    "CrossTarget",
    "EvaluateSection",
    "FlatTopTarget",
    "ImageTarget",
    "LensSection",
    "ManufactureSection",
    "OptimiseSection",
    "Spec",
    "Target",
    "TextTarget",
    "Tool",
    "load_spec",
    "parse_spec",
]
