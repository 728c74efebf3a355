"""The functions and classes behind ``import seaclutter``, with plain arguments in place of options."""
