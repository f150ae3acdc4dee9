"""What all tables of a problem file have in common."""

from collections.abc import Mapping
from typing import Any, ClassVar

import pydantic


class StrictTable(pydantic.BaseModel):
    """A table with known keys; numbers are finite, and no value is converted to another kind."""

    model_config = pydantic.ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=False
    )


class ShortTable(StrictTable):
    """A table that may be given by one of its values alone."""

    alone: ClassVar[str]
    """The key of that value."""

    @pydantic.model_validator(mode="before")
    @classmethod
    def _value_alone(cls, given: Any) -> Any:
        return given if isinstance(given, Mapping | cls) else {cls.alone: given}

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: Any) -> dict[str, Any]:
        """Allow the value alone beside the table."""
        table = handler.resolve_ref_schema(handler(core))
        return {"anyOf": [dict(table["properties"][cls.alone]), dict(table)]}
