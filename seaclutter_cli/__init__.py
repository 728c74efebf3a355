"""Filter sea clutter out of recorded marine lidar logs.

The package exports the names in the stub file next to this one, as does ``import seaclutter``. Each name is imported
when it is first used.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
