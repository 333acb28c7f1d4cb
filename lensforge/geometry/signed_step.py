"""The solid of a lens on its base, and its STEP file with the header and the tolerances that the spec asks for."""

from dataclasses import dataclass

from lensforge.cad_files.step_settings import Schema
from lensforge.geometry.custom_base import CustomBase, join_base
from lensforge.geometry.form_tolerance import FormTolerance
from lensforge.geometry.part import Signature
from lensforge.geometry.patch import Patch
from lensforge.geometry.plan import Plan
from lensforge.geometry.solid import Solid, build_solid
from lensforge.geometry.step import step_bytes
from lensforge.geometry.step_header import StepHeader
from lensforge.geometry.step_tolerances import form_tolerances
from lensforge.spec import Spec


@dataclass(frozen=True)
class SignedStep:
    """The bytes of the file, its author and date, as a header too, and the tolerances on its faces."""

    content: bytes
    signature: Signature
    header: StepHeader
    tolerances: tuple[FormTolerance, ...]


def solid_on_base(plan: Plan[Patch], base: CustomBase | None) -> Solid:
    """The solid of ``plan``, joined with the ``base`` where it comes from a file."""
    solid = build_solid(plan)
    return solid if base is None else join_base(solid, base)


def signed_step(solid: Solid, spec: Spec, product: str, schema: Schema, date: str | None = None) -> SignedStep:
    """STEP file of ``solid`` as ``product``; AP242 carries ``manufacture.form_tolerance_um``.

    ``date``: by default ``manufacture.date``. Raises :class:`InputError` for tolerances that the kernel does not write.
    """
    shop = spec.manufacture
    signature = Signature(author=shop.author, organisation=shop.organisation, date=date or shop.date)
    header = StepHeader(**signature.model_dump())
    width_um = shop.form_tolerance_um if schema == "AP242" else None
    tolerances = () if width_um is None else form_tolerances(solid.faces, width_um)
    content = step_bytes(solid, product, schema, header=header, tolerances=tolerances)
    return SignedStep(content, signature, header, tolerances)
