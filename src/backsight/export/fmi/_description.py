"""XML files of an FMU: model description, how to build it, terminals and icon."""

from collections.abc import Sequence
from importlib.metadata import version
from typing import Any
from xml.etree import ElementTree as ET

from backsight.export._written import Written, one_line
from backsight.export.fmi._variables import Variable, clock_reference
from backsight.units import base_units

FMI = "3.0"


def model_description(code: Written, found: Sequence[Variable], token: str) -> bytes:
    """``modelDescription.xml``."""
    root = ET.Element(
        "fmiModelDescription",
        fmiVersion=FMI,
        modelName=one_line(code.model.name) or code.name,
        instantiationToken=token,
        description=f"{code.estimator.title}, a sample every {code.recursion.dt:g} s",
        generationTool=f"Backsight {version('backsight')}",
        variableNamingConvention="structured",
    )
    able = {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true"}
    steps = {"canHandleVariableCommunicationStepSize": "false"}
    steps["fixedInternalStepSize"] = repr(code.recursion.dt)
    ET.SubElement(root, "CoSimulation", able | steps, modelIdentifier=code.name)
    ET.SubElement(root, "ScheduledExecution", able, modelIdentifier=code.name)
    _units(root, sorted({v.unit for v in found if v.unit}))
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError", description="why a call failed")
    ET.SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(code.recursion.dt))
    listed = ET.SubElement(root, "ModelVariables")
    for variable in found:
        _variable(listed, variable)
    # Variables do not belong to the clock: clocked ones could not be set in co-simulation, which
    # has no events here.
    ET.SubElement(
        listed,
        "Clock",
        name="sample",
        valueReference=str(clock_reference(found)),
        description="a tick is a sample, in scheduled execution",
        causality="input",
        intervalVariability="constant",
        intervalDecimal=repr(code.recursion.dt),
    )
    structure = ET.SubElement(root, "ModelStructure")
    outputs = [v for v in found if v.causality == "output"]
    for kind in ("Output", "InitialUnknown"):
        for variable in outputs:
            ET.SubElement(structure, kind, valueReference=str(variable.reference))
    return _text(root)


def build_description(code: Written, files: Sequence[str]) -> bytes:
    """``sources/buildDescription.xml``."""
    root = ET.Element("fmiBuildDescription", fmiVersion=FMI)
    build = ET.SubElement(root, "BuildConfiguration", modelIdentifier=code.name)
    sources = ET.SubElement(build, "SourceFileSet", language="C99")
    for name in files:
        ET.SubElement(sources, "SourceFile", name=name)
    ET.SubElement(build, "Library", name="m", external="true")
    return _text(root)


def terminals(found: Sequence[Variable]) -> bytes:
    """``terminalsAndIcons/terminalsAndIcons.xml``: what is measured, and what is estimated."""
    root = ET.Element("fmiTerminalsAndIcons", fmiVersion=FMI)
    graphics = ET.SubElement(root, "GraphicalRepresentation")
    square = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    ET.SubElement(graphics, "CoordinateSystem", square, suggestedScalingFactorTo_mm="0.1")
    ET.SubElement(graphics, "Icon", square)
    both = ET.SubElement(root, "Terminals")
    for name, kind in (("measured", "input"), ("estimated", "output")):
        terminal = ET.SubElement(both, "Terminal", name=name, matchingRule="bus")
        for v in found:
            if v.causality == kind:
                member = {"variableName": v.name, "memberName": v.name, "variableKind": "signal"}
                ET.SubElement(terminal, "TerminalMemberVariable", member)
    return _text(root)


def _units(root: ET.Element, units: Sequence[str]) -> None:
    if not units:
        return
    definitions = ET.SubElement(root, "UnitDefinitions")
    for unit in units:
        entry = ET.SubElement(definitions, "Unit", name=unit)
        found = base_units(unit)
        if found is not None:
            powers = {name: str(power) for name, power in found.powers.items()}
            scale: dict[str, str] = {}
            if found.factor != 1.0:
                scale["factor"] = repr(found.factor)
            if found.offset != 0.0:
                scale["offset"] = repr(found.offset)
            ET.SubElement(entry, "BaseUnit", {**powers, **scale})


def _variable(listed: ET.Element, v: Variable) -> None:
    about: dict[str, Any] = {"name": v.name, "valueReference": str(v.reference)}
    about |= {"description": v.about, "causality": v.causality}
    if v.causality == "independent":
        about |= {"variability": "continuous", "unit": v.unit}
    elif v.causality == "parameter":
        about |= {"variability": "fixed" if v.fixed else "tunable"}
        about |= {"initial": "exact", "start": repr(v.start)}
    elif v.causality == "input":
        about |= {"variability": "discrete", "start": repr(v.start)}
    else:
        about |= {"variability": "discrete", "initial": "calculated"}
    if v.unit and not v.whole:
        about["unit"] = v.unit
    ET.SubElement(listed, "Int32" if v.whole else "Float64", about)


def _text(root: ET.Element) -> bytes:
    ET.indent(root)
    return ET.tostring(root, encoding="UTF-8", xml_declaration=True)
