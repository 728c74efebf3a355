from seaclutter_cli import *
from seaclutter_cli import __version__ as __version__
