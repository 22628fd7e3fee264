"""Command-line options made from settings models, so that each setting is described once."""

import argparse
import sys
from collections.abc import Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from homolog.errors import InputError
from homolog.parameters import Parameter, parameters
from homolog.settings import GroomSettings, RunSettings

__all__ = ["add_former_name", "add_options", "options_of", "with_all_options", "with_options"]

_Model = TypeVar("_Model", bound=BaseModel)
_AUTO = "auto"
_OR_NAME = "; or the name of a structure, as homolog labels lists them"


def add_options(
    parser: argparse.ArgumentParser, model: type[BaseModel], leaving_out: Sequence[str] = ()
) -> None:
    """Declare an option for each setting of the model; an option that isn't given leaves no trace."""
    group = parser.add_argument_group(_title(model))
    for parameter in parameters(model):
        if parameter.name in leaving_out:
            continue
        if parameter.kind is bool:
            group.add_argument(
                _option(parameter),
                action=argparse.BooleanOptionalAction,
                default=argparse.SUPPRESS,
                help=_help(parameter),
            )
        else:
            group.add_argument(
                _option(parameter),
                default=argparse.SUPPRESS,
                metavar="{" + ",".join(parameter.choices) + "}"
                if parameter.choices
                else parameter.kind.__name__.upper(),
                help=_help(parameter)
                + (_OR_NAME if model is GroomSettings and parameter.name == "label" else ""),
            )


class _FormerName(argparse.Action):
    """A hidden option that does what the present one does, and says what that is called."""

    def __init__(self, present: argparse.Action, **kwargs: Any) -> None:  # noqa: ANN401 - argparse's own
        super().__init__(**kwargs)
        self._present = present

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,  # noqa: ANN401 - argparse's own
        option_string: str | None = None,
    ) -> None:
        name = self._present.option_strings[0]
        sys.stderr.write(f"homolog: {option_string} is now called {name}; the old name will be removed\n")
        self._present(parser, namespace, values, option_string)


def add_former_name(parser: argparse.ArgumentParser, former: str, present: argparse.Action) -> None:
    """Let an option be given by its former name, with a hint on standard error; help does not list it."""
    parser.add_argument(
        former,
        action=_FormerName,
        present=present,
        dest=present.dest,
        nargs=present.nargs,
        type=present.type or str,
        default=argparse.SUPPRESS,
        help=argparse.SUPPRESS,
    )


def with_options(settings: _Model, arguments: argparse.Namespace) -> _Model:
    """Return the settings with those that the command line names put in.

    Raises
    ------
    InputError
        One line for each value that is no such value or out of bounds.
    """
    given = {
        parameter.name: None if value == _AUTO and parameter.default is None else value
        for parameter in parameters(type(settings))
        if (value := getattr(arguments, parameter.name, parameter)) is not parameter
    }
    try:
        return type(settings).model_validate(settings.model_dump() | given)
    except ValidationError as error:
        lines = [
            f"--{str(item['loc'][0]).replace('_', '-')} {item['input']}: {item['msg']}"
            for item in error.errors()
        ]
        raise InputError("\n".join(dict.fromkeys(lines))) from error


def with_all_options(settings: RunSettings, arguments: argparse.Namespace) -> RunSettings:
    """Return a run's settings with those that the command line names; ``--label`` takes a name, too.

    Raises
    ------
    InputError
        As `with_options` does.
    """
    structure = getattr(arguments, "label", None)
    if structure is not None:  # names the structure anew: what was chosen before is no more
        named = structure != _AUTO and not structure.strip().lstrip("+-").isdecimal()
        defaults = {"label": _AUTO, "segment": structure} if named else {"segment": _AUTO} | vars(arguments)
        arguments = argparse.Namespace(**(vars(arguments) | defaults))
    groom, optimize = with_options(settings.groom, arguments), with_options(settings.optimize, arguments)
    return with_options(settings, arguments).model_copy(update={"groom": groom, "optimize": optimize})


def options_of(settings: BaseModel) -> list[str]:
    """Return the words on a command line that give these settings: those that aren't at their default."""
    line: list[str] = []
    for parameter in parameters(type(settings)):
        value = getattr(settings, parameter.name)
        if value == parameter.default:
            continue
        if parameter.kind is bool:
            line.append(_option(parameter) if value else _option(parameter).replace("--", "--no-", 1))
        else:
            line += [
                f"{_option(parameter)}={_AUTO if value is None else value}"
            ]  # = as numbers may begin with -
    return line


def _option(parameter: Parameter) -> str:
    return f"--{parameter.name.replace('_', '-')}"


def _title(model: type[BaseModel]) -> str:
    return (model.__doc__ or model.__name__).split("\n")[0].rstrip(".").lower()


def _help(parameter: Parameter) -> str:
    default = _AUTO if parameter.default is None else parameter.default
    if parameter.kind is bool:
        default = "on" if default else "off"
    facts = [parameter.bounds, parameter.unit, f"default {default}"]
    return f"{parameter.help} ({', '.join(fact for fact in facts if fact)})".replace("%", "%%")
