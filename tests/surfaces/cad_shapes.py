"""CAD files with faces about the origin, made by the CAD kernel itself."""

from pathlib import Path

import cadquery as cq
from OCP.BRepPrimAPI import BRepPrimAPI_MakeSphere
from OCP.gp import gp_Ax2, gp_Dir, gp_Pnt


def ball(radius_mm: float, centre_mm: float = 0.0, axis: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> cq.Shape:
    """A whole ball; its sphere has its poles on ``axis``."""
    frame = gp_Ax2(gp_Pnt(0.0, 0.0, centre_mm), gp_Dir(*axis))
    return cq.Shape.cast(BRepPrimAPI_MakeSphere(frame, radius_mm).Shape())


def shell(inner: cq.Shape, outer: cq.Shape) -> cq.Shape:
    """What lies between two shapes, above z = 0."""
    above = cq.Workplane("XY").box(200.0, 200.0, 100.0, centered=(True, True, False)).val()
    return outer.cut(inner).intersect(above)


def write(shape: cq.Shape, path: Path) -> Path:
    """``shape`` as a STEP or IGES file, by the suffix."""
    if path.suffix == ".step":
        cq.exporters.export(cq.Workplane(obj=shape), str(path))
        return path
    from OCP.IGESControl import IGESControl_Controller, IGESControl_Writer

    IGESControl_Controller.Init_s()
    writer = IGESControl_Writer("MM", 1)
    writer.AddShape(shape.wrapped)
    writer.ComputeModel()
    assert writer.Write(str(path))
    return path


def in_inches(path: Path, to: Path) -> Path:
    """The same numbers with inches as the unit of length."""
    text = path.read_text()
    metre = "( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.) )"
    assert metre in text
    number = max(int(line.split("=")[0][1:]) for line in text.splitlines() if line.startswith("#")) + 1
    unit = text.split(metre)[0].splitlines()[-1].split("=")[0].strip()
    inch = (
        f"{unit} = ( CONVERSION_BASED_UNIT('INCH',#{number}) LENGTH_UNIT() NAMED_UNIT(#{number + 1}) );\n"
        f"#{number} = LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#{number + 2});\n"
        f"#{number + 1} = DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);\n"
        f"#{number + 2} = {metre};"
    )
    to.write_text(text.replace(f"{unit} = {metre};", inch))
    return to
