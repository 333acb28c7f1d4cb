"""What is wanted? The TOML of a design: validated once, immutable, every length in mm."""

from lensforge.spec.accuracy import Accuracy, AnyAccuracy, Preset
from lensforge.spec.design_spec import Spec, load_spec, parse_spec
from lensforge.spec.face_section import FaceSection
from lensforge.spec.further_targets import ArrayTarget, BeamTarget, ImageTarget, TableTarget, TextTarget
from lensforge.spec.lens_section import LensSection
from lensforge.spec.part_section import BaseSection, DrawingSection, ManufactureSection, Tool
from lensforge.spec.receiver_fields import ReceiverSection
from lensforge.spec.search_section import ConstraintsSection, EvaluateSection, OptimiseSection
from lensforge.spec.shape_targets import CrossTarget, FlatTopTarget, RectangleTarget
from lensforge.spec.target_sections import TargetSection

__all__ = [
    "Accuracy",
    "AnyAccuracy",
    "ArrayTarget",
    "BaseSection",
    "BeamTarget",
    "ConstraintsSection",
    "CrossTarget",
    "DrawingSection",
    "EvaluateSection",
    "FaceSection",
    "FlatTopTarget",
    "ImageTarget",
    "LensSection",
    "ManufactureSection",
    "OptimiseSection",
    "Preset",
    "ReceiverSection",
    "RectangleTarget",
    "Spec",
    "TableTarget",
    "TargetSection",
    "TextTarget",
    "Tool",
    "load_spec",
    "parse_spec",
]
