"""Command-line options from the fields of a plan: one place says what there is, its unit and its bounds."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from types import GenericAlias, UnionType
from typing import Annotated, Any, Final, Literal, get_args, get_origin

import typer
from pydantic.fields import FieldInfo

from hil.identify.experiments import Plan

SAME: Final = {"duration_s": "duration", "period_s": "period", "fade_s": "fade", "hold_s": "hold"}
"""Options are named without their unit, which stands in the help."""
HIDDEN: Final = ("kind", "sha256")


def options_of(model: type[Plan]) -> Iterable[inspect.Parameter]:
    """An option for each field of a kind of plan; lists are given with commas between."""
    return [_option(n, f) for n, f in model.model_fields.items() if n not in HIDDEN]


def values_of(model: type[Plan], given: dict[str, Any]) -> dict[str, Any]:
    """What was given on the command line, with lists taken apart."""
    values = dict(given)
    for name, field in model.model_fields.items():
        if get_origin(field.annotation) is tuple and name in values:
            values[name] = [part.strip() for part in values[name].split(",") if part.strip()]
    return values


def _option(name: str, field: FieldInfo) -> inspect.Parameter:
    kind: Any = field.annotation
    origin = get_origin(kind)
    if isinstance(kind, GenericAlias | UnionType) or origin in (tuple, Literal):
        choices = "|".join(get_args(kind)) if origin is Literal else "A,B,..."
        option, kind = typer.Option(f"--{_flag(name)}", help=_help(field), metavar=choices), str
    else:
        option = typer.Option(f"--{_flag(name)}", help=_help(field))
    default: Any = ... if field.is_required() else field.get_default()
    if origin is tuple:
        default = ",".join(map(str, default))
    return inspect.Parameter(
        name,
        inspect.Parameter.KEYWORD_ONLY,
        default=inspect.Parameter.empty if default is ... else default,
        annotation=Annotated[kind, option],
    )


def _flag(name: str) -> str:
    return SAME.get(name, name).replace("_", "-")


def _help(field: FieldInfo) -> str:
    text = field.description or ""
    return text[:1].upper() + text[1:]  # units keep their capitals
