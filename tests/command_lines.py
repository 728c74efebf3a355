"""The ``seaclutter`` command lines of documents and scripts, and whether the program would accept them."""

import contextlib
import re
import shlex
from pathlib import PurePosixPath

import click

from seaclutter_cli.commands import cli
from seaclutter_cli.filters import FILTERS

_BLOCK = re.compile(r"^( *)```(\w*).*?\n(.*?)^\1```", re.MULTILINE | re.DOTALL)
_INLINE = re.compile(r"`seaclutter ([^`]+)`")
_ASSIGNMENT = re.compile(r"\w+=")


def in_blocks(markdown):
    """Yield the arguments of every command line in fenced shell blocks."""
    for _, language, text in _BLOCK.findall(markdown):
        if language in ("sh", "bash"):
            yield from in_script(text)


def in_script(text):
    """Yield the arguments of every command line of a shell script."""
    for line in text.replace("\\\n", " ").splitlines():
        for words in _simple_commands(line):
            if words[:2] == ["docker", "run"] and "--entrypoint" not in words:
                yield words[words.index("seaclutter") + 1 :]
            elif words and PurePosixPath(words[0]).name == "seaclutter":
                yield words[1:]


def inline(markdown):
    """Yield the words of every command line within the text, which may be incomplete."""
    for text in _INLINE.findall(_BLOCK.sub("", markdown)):
        yield next(_simple_commands(" ".join(text.split())))


def check(arguments):
    """Raise an error unless the program accepts a command line."""
    name, command, rest = resolve(arguments)
    if any("$" in word for word in rest):  # variables have no values
        check_names(arguments)
    elif rest or command is not cli:  # without any, it is a call for shell completion
        with contextlib.suppress(click.exceptions.Exit):  # --help and --version
            context = command.make_context(name, rest)
            methods = {context.params.get("method"), *(context.params.get("methods") or ())} - {None}
            assert methods <= {*FILTERS, "mine.py:above_the_surface", "global_intensity@0.80", "global_intensity@0.90"}


def check_names(arguments):
    """Raise an error unless commands and options of a command line exist; arguments may be missing."""
    name, command, rest = resolve(arguments)
    command.make_parser(click.Context(command, info_name=name)).parse_args(list(rest))


def resolve(arguments):
    """Return the name of the command, the command, and the other arguments."""
    name, command, rest = "seaclutter", cli, list(arguments)
    while isinstance(command, click.Group) and rest and not rest[0].startswith("-"):
        group, name = command, rest.pop(0)
        command = group.get_command(click.Context(group), name)
        assert command, f"no command {name}"
    return name, command, rest


def option_names(command=cli):
    """Return the names of all options of a command and its subcommands."""
    names = {
        name
        for parameter in command.get_params(click.Context(command))
        for name in (*parameter.opts, *parameter.secondary_opts)
    }
    if isinstance(command, click.Group):
        context = click.Context(command)
        names.update(*(option_names(command.get_command(context, name)) for name in command.list_commands(context)))
    return names


def _simple_commands(line):
    """Yield the words of each command of a line, without redirections, assignments and keywords."""
    lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
    lexer.whitespace_split = True
    words, skip = [], False
    for word in (*lexer, ";"):
        if set(word) <= set(";&|()"):
            yield words
            words = []
        elif set(word) <= set("<>"):
            skip = True
        elif skip:
            skip = False
        elif words or not (_ASSIGNMENT.match(word) or word in ("do", "then")):
            words.append(word)
