"""Commands made from declared options: their parameters, checks, help in groups, and environment variables."""

import math
import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import MISSING
from importlib import import_module
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from seaclutter_cli.commands.console import ARGUMENTS, DEBUG, NOTES, Console
from seaclutter_cli.errors import ConfigError
from seaclutter_cli.options import Choice, Flag, Kind, Number, Option, Options, Whole, declared
from seaclutter_cli.registry import imported
from seaclutter_cli.runs.options import WORKING_CONFIG, ConfigFile, MethodName

_GROUPS = {
    "Input": "columns rate calibration sensor integrate intensity-field join merge recursive clutter-ids ignore-ids",
    "Method": "compare filter-rate max-left choose trade-off hold-out keep-end clustering epochs batch learning-rate",
    "Output": "to keep-raw with-removed keep-organized diagnostics compression split include exclude latched "
    "summary csv objects suspects with-scene plot plot-thresholds ring figures figure-format pictures show pick "
    "geojson",
    "Many recordings": "jobs fail-fast resume manifest cluster cluster-insecure",
    "Messages": "dry-run json quiet verbose log-file debug",
}
"""Options in the help, after the usual ones, which belong to no group."""

_GROUP_OF = {f"--{name}": group for group, names in _GROUPS.items() for name in names.split()}


class _Command(click.Command):
    """Command whose help shows the usual options first, and the others in groups."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        sections: dict[str, list[tuple[str, str]]] = {name: [] for name in ("Options", *_GROUPS)}
        for parameter in self.get_params(ctx):
            if isinstance(parameter, click.Option) and (record := parameter.get_help_record(ctx)):
                sections[_GROUP_OF.get(max(parameter.opts, key=len), "Options")].append(record)
        for name, records in sections.items():
            if records:
                with formatter.section(name):
                    formatter.write_dl(records)


class _Value(click.ParamType[Any]):
    def __init__(self, kind: Kind) -> None:
        self.name, self._kind = "text", kind

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        try:
            parsed = self._kind.parse(value) if isinstance(value, str) else value
            return self._kind.check(parsed, param.opts[0] if param else "")
        except ValueError as error:
            self.fail(str(error), param, ctx)


class _Method(_Value):
    """A method; only the command line may name a file, which is run."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        is_given = ctx and param and ctx.get_parameter_source(str(param.name)) is not ParameterSource.ENVIRONMENT
        if ".py:" in value and not is_given:
            self.fail(f"{value}: a file of your own is named on the command line only", param, ctx)
        return super().convert(value, param, ctx)


class _ConfigFile(_Value):
    """A configuration: a file, the name of a built-in one, or ``-`` for standard input."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value != "-":
            return super().convert(value, param, ctx)
        from seaclutter_cli.config import parse_sections
        from seaclutter_cli.documents import MAX_YAML_CHARACTERS

        try:
            text = sys.stdin.read(MAX_YAML_CHARACTERS + 1)
        except UnicodeDecodeError as error:
            raise ConfigError("standard input: not UTF-8 text") from error
        return parse_sections(text, "standard input")


class _Finite(click.FloatRange):
    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        number = super().convert(value, param, ctx)
        return number if math.isfinite(number) else self.fail(f"{value} is not a finite number.", param, ctx)


class _Choice(click.Choice[str]):
    """A name, which may stand for another value."""

    def __init__(self, kind: Choice) -> None:
        super().__init__(list(kind.names))
        self._kind = kind

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value not in self.choices:
            self.choices = (*self.choices, *self._kind.more())
        return self._kind.parse(super().convert(value, param, ctx))


_OWN: Mapping[type[Kind], type[_Value]] = {ConfigFile: _ConfigFile, MethodName: _Method}


def _type_of(kind: Kind) -> click.ParamType[Any]:
    if isinstance(kind, Flag):
        return click.BOOL
    if isinstance(kind, Whole):
        least, most = (None if limit is None else int(limit) for limit in (kind.least, kind.most))
        return click.IntRange(least, most)
    if isinstance(kind, Number):
        return _Finite(kind.least, kind.most, min_open=kind.above, max_open=kind.below)
    if isinstance(kind, Choice):
        return _Choice(kind)
    return _OWN.get(type(kind), _Value)(kind)


def _of_working_folder(context: click.Context, _: click.Parameter, value: Any) -> Any:
    """Return the configuration in the working folder if none is given."""
    if value is not None or not Path(WORKING_CONFIG).is_file():
        return value
    from seaclutter_cli.config import UnnamedFile

    context.meta[NOTES] = [f"using {WORKING_CONFIG} in the working folder; -c chooses another configuration"]
    return UnnamedFile(WORKING_CONFIG)


def _parameter(name: str, one: Option, words: Mapping[str, str]) -> click.Parameter:
    is_required = one.required or one.default is MISSING
    if not one.flags[0].startswith("-"):
        number = -1 if one.flags[0].endswith("...") else 1
        return click.Argument([name], metavar=one.flags[0], nargs=number, required=is_required)
    text = one.help
    for word, other in words.items():
        text = text.replace(word, other)
    keywords: dict[str, Any] = {"is_flag": True} if isinstance(one.kind, Flag) else {"type": _type_of(one.kind)}
    if not is_required:
        keywords["default"] = one.default if one.of_command is MISSING else one.of_command
    if isinstance(one.kind, ConfigFile):
        keywords["callback"] = _of_working_folder
    return click.Option(
        [*one.flags, name],
        metavar=one.metavar or one.kind.metavar,
        multiple=one.repeatable,
        required=is_required,
        show_default=not isinstance(one.kind, Flag) and keywords.get("default") not in (None, "", ()),
        help=text,
        **keywords,
    )


_DEBUG = click.Option(
    ["--debug"],
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=lambda context, _, value: context.meta.update({DEBUG: True} if value else {}),
    help="Show the traceback of an error.",
)


_OUTPUTS = ("-o", "--output", "--figures", "--log-file")
_FLAGS = ("--force", "-q", "--quiet", "-v", "--verbose", "--debug", "--json")


def _effective(arguments: Sequence[str]) -> list[str]:
    """Return the arguments as far as results depend on them: with OUT in place of outputs, and without such flags."""
    shown: list[str] = []
    for argument in arguments:
        name, equals, _ = argument.partition("=")
        if shown and shown[-1] in _OUTPUTS:
            shown.append("OUT")
        elif equals and name in _OUTPUTS:
            shown.append(f"{name}=OUT")
        elif argument.startswith("-o") and argument != "-o":
            shown.append("-oOUT")
        elif argument not in _FLAGS:
            shown.append(argument)
    return shown


def commands_of(module: str, name: str) -> list[click.Command]:
    """Return the command of a name, or those of a group of this name, from the use cases in a module."""
    found = vars(import_module(f"seaclutter_cli.{module}")).values()
    kinds = (one for one in found if isinstance(one, type) and issubclass(one, Options) and "use_case" in vars(one))
    return [_command(one) for one in kinds if one.use_case.name.partition(" ")[0] == name]


def _command(takes: type[Options]) -> click.Command:
    """Return the command of a class of options, which calls their function and prints its result."""
    use_case, options = takes.use_case, declared(takes)
    own = {name: one for name, one in options.items() if one.flags}
    messages = (*(["dry_run"] if use_case.plan else []), *use_case.messages)
    parameters = [_parameter(name, one, takes.words) for name, one in own.items()]
    parameters += [_parameter(name, one, {}) for name, one in declared(Console).items() if name in messages]

    def run(**values: Any) -> None:
        console = Console(**{name: values[name] for name in messages})
        taken, function = {name: values[name] for name in own}, use_case.function
        if not isinstance(function, str):
            function(console, **taken)
            return
        if "keep_going" in options:
            taken["keep_going"] = True
        if "command" in options:
            arguments = _effective(click.get_current_context().meta.get(ARGUMENTS, ()))
            taken["command"] = shlex.join(["seaclutter", *arguments])
        planned = use_case.plan if console.dry_run else None
        console.finish(imported(planned or function)(**taken, observer=console))

    for parameter in parameters:
        if isinstance(parameter, click.Option) and parameter.expose_value:
            longest = max(parameter.opts, key=len).strip("-")
            parameter.envvar = re.sub("[ -]", "_", f"seaclutter {use_case.name} {longest}").upper()
    last = use_case.name.rpartition(" ")[2]
    parameters.append(_DEBUG)
    return _Command(last, callback=run, params=parameters, help=takes.__doc__, short_help=use_case.short_help)
