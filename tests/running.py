"""Command lines, run in this process."""

from click.testing import CliRunner, Result

from seaclutter_cli.commands import cli


def execute(*words: object, code: int | None = None, **options: object) -> Result:
    """Return the result of a command line, after asserting that it ends as a program does, with an exit status."""
    result = CliRunner().invoke(cli, [str(word) for word in words], **options)
    assert isinstance(result.exception, SystemExit | None), result.exc_info
    assert code is None or result.exit_code == code, result.output
    return result
