"""Use cases as plain functions: options in, results out, progress and warnings through an `Observer`.

Nothing here prints, exits or knows of a command line; `seaclutter_cli.commands` is a skin over it, and
`seaclutter_cli.api` another one for notebooks and programs.
"""
