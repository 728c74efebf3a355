"""Run the program as ``python -m seaclutter_cli``."""

from seaclutter_cli.commands import main

if __name__ == "__main__":
    main()
