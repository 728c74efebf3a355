"""Use cases as plain functions: options in, results out, progress and warnings through an `Observer`.

Nothing here prints, exits or depends on a command line. `seaclutter_cli.commands` wraps these functions for the
terminal, `seaclutter_cli.api` for programs and notebooks.
"""
