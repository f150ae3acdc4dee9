"""Tables of sensors and forces in files of their own: put into the problem as if written there."""

from pathlib import Path
from typing import Any

from backsight.data.finite_elements import SensorList, read_forces, read_sensors
from backsight.errors import ProblemError
from backsight.models.model import Model
from backsight.problem.reading.checking import at


def put_places(given: dict[str, Any], folder: Path) -> SensorList | None:
    """Replace paths in ``[model]`` by what is in the tables; noise of sensors goes to ``[noise]``.

    A standard deviation that the problem file gives itself stays.

    Raises
    ------
    ProblemError
        If a table cannot be read.
    """
    model, listed = given.get("model"), None
    if not isinstance(model, dict):
        return None
    if isinstance(path := model.get("sensors"), str):
        with at("model.sensors"):
            listed = read_sensors(folder / path)
        model["sensors"] = {
            name: {"kind": kind, "at": place} for name, (kind, place) in listed.sensors.items()
        }
        noise = given.setdefault("noise", {})
        if isinstance(noise, dict) and "R" not in noise and listed.noise:
            noise["sigma_y"] = {**listed.noise, **noise.get("sigma_y", {})}
    for key in ("forces", "inputs"):
        if isinstance(path := model.get(key), str):
            with at(f"model.{key}"):
                model[key] = read_forces(folder / path)
    return listed


def check_units(listed: SensorList | None, model: Model) -> None:
    """Raise `ProblemError` if a sensor of a table has another unit than the model gives it."""
    units = {s.name: s.unit for s in model.outputs}
    for name, unit in listed.units.items() if listed else ():
        if units[name] and unit != units[name]:
            raise ProblemError(
                f"model.sensors: '{name}' is in {unit}, but the model gives it in {units[name]}; "
                f"write {units[name]} and the noise in it, and give recording.outputs.{name} the "
                "factor from the file's unit"
            )
