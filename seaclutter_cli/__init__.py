"""Filter sea clutter out of recorded marine lidar logs.

``import seaclutter`` gives the same names as this package: those of the stub beside this file, which are imported when
they are first used.
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
