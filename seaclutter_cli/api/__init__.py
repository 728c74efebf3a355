"""Functions and classes behind ``import seaclutter``, with plain arguments in place of options objects."""
