"""Filter sea clutter out of recorded marine lidar logs: the public names of `seaclutter_cli`."""

from typing import Any

import seaclutter_cli
from seaclutter_cli import __all__ as __all__
from seaclutter_cli import __version__ as __version__


def __getattr__(name: str) -> Any:
    return getattr(seaclutter_cli, name)


def __dir__() -> list[str]:
    return sorted(__all__)
