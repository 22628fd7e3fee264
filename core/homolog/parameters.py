"""The fields of a settings model, from which command lines and forms are generated."""

from dataclasses import dataclass
from enum import Enum
from types import UnionType
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

__all__ = ["Parameter", "fault_text", "parameters"]

_FAULTS = {
    "greater_than_equal": "must be at least {ge:g}",
    "greater_than": "must be more than {gt:g}",
    "less_than_equal": "must be at most {le:g}",
    "less_than": "must be less than {lt:g}",
    "multiple_of": "must be a multiple of {multiple_of:g}",
    "enum": "must be {expected}",
    "literal_error": "must be {expected}",
    "bool_parsing": "must be true or false",
    "int_parsing": "must be a whole number",
    "int_from_float": "must be a whole number",
    "float_parsing": "must be a number",
    "finite_number": "must be finite",
}


@dataclass(frozen=True, slots=True)
class Parameter:
    """One setting.

    Attributes
    ----------
    name : str
        The field's name.
    kind : type
        ``bool``, ``int``, ``float`` or ``str``, or the `Enum` of a closed set of values.
    automatic : bool
        Whether the value may be left to the program (None).
    default : object
        The default value.
    low, high : float or None
        Bounds, if any. With `low_excluded`, `low` itself is not allowed.
    low_excluded : bool
    unit : str
        Unit; empty for dimensionless numbers.
    help : str
        Help in one or two sentences.
    title : str
        Display name if it differs from the field's name.
    example : str
        Example of a text.
    if_none : str
        What None means.
    """

    name: str
    kind: type
    automatic: bool
    default: Any
    low: float | None
    high: float | None
    low_excluded: bool
    unit: str
    help: str
    title: str = ""
    example: str = ""
    if_none: str = "automatic"

    @property
    def label(self) -> str:
        """Display name: ``"mesh edge"``."""
        return self.title or self.name.replace("_", " ")

    @property
    def choices(self) -> tuple[str, ...]:
        """The values of a closed set; empty for anything else."""
        return tuple(str(item.value) for item in self.kind) if issubclass(self.kind, Enum) else ()

    @property
    def bounds(self) -> str:
        """Text of the bounds: ``"4 to 65536"``, or an empty text."""
        if self.low is None or self.high is None:
            return ""
        low, high = (int(bound) if bound == int(bound) else bound for bound in (self.low, self.high))
        return f"above {low}, at most {high}" if self.low_excluded else f"{low} to {high}"


def parameters(model: type[BaseModel]) -> list[Parameter]:
    """Return the model's own settings in order, without the models nested in it."""
    return [
        _parameter(name, field)
        for name, field in model.model_fields.items()
        if not (isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel))
    ]


def fault_text(fault: ErrorDetails) -> str:
    """Return the message on an invalid value."""
    text = _FAULTS.get(fault["type"])
    return fault["msg"] if text is None else text.format(**fault.get("ctx", {}))


def _parameter(name: str, field: FieldInfo) -> Parameter:
    kind, automatic = _kind(field.annotation)
    bounds = {
        bound: getattr(item, bound)
        for item in field.metadata
        for bound in ("ge", "gt", "le", "lt")
        if getattr(item, bound, None) is not None
    }
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    return Parameter(
        name=name,
        kind=kind,
        automatic=automatic,
        default=field.default,
        low=bounds.get("ge", bounds.get("gt")),
        high=bounds.get("le", bounds.get("lt")),
        low_excluded="gt" in bounds,
        unit=str(extra.get("unit", "")),
        help=field.description or "",
        title=field.title or "",
        example=str((field.examples or [""])[0]),
        if_none=str(extra.get("if_none", "automatic")),
    )


def _kind(annotation: Any) -> tuple[type, bool]:  # noqa: ANN401 - annotations have no common type
    """Return the type of a value, and whether it may be None (automatic)."""
    if get_origin(annotation) not in (Union, UnionType):
        return annotation, False
    (kind,) = [get_arg for get_arg in get_args(annotation) if get_arg is not type(None)]
    return kind, True
