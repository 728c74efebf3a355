"""The command line of this run, for results that say where they come from."""

import shlex
from collections.abc import Sequence

import click

ARGUMENTS = "seaclutter.arguments"
"""Key in a context's ``meta`` for the arguments of the program."""

_OUTPUTS = ("-o", "--output", "--figures", "--log-file")
_FLAGS = ("--force", "-q", "--quiet", "-v", "--verbose", "--debug", "--json")


def command_line() -> str:
    """Return the command line as far as results depend on it: with OUT in place of outputs, and without such flags."""
    arguments = click.get_current_context().meta.get(ARGUMENTS, ())
    return shlex.join(["seaclutter", *_effective(arguments)])


def _effective(arguments: Sequence[str]) -> list[str]:
    """Return the arguments on which results depend.

    Examples
    --------
    >>> _effective(["report", "a.mcap", "-o", "a.html", "--force"]), _effective(["--output=a.html", "-oa.html"])
    (['report', 'a.mcap', '-o', 'OUT'], ['--output=OUT', '-oOUT'])
    """
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
