"""Run the program, as ``seaclutter`` or ``python -m seaclutter_cli``."""

import sys


def main() -> None:
    """Run the program; an interrupt ends it without a traceback, also while it is imported."""
    try:
        from seaclutter_cli.commands import main as run
    except KeyboardInterrupt:
        sys.exit(1)
    run()


if __name__ == "__main__":
    main()
