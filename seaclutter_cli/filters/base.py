"""What most filters have in common: no state and no first pass."""

from seaclutter_cli.frame import Frame


class BaseFilter:
    """A filter without state that needs no first pass; subclasses add ``Params`` and ``step``."""

    needs_first_pass = False

    def observe(self, frame: Frame) -> None:
        """Ignore the frame."""

    def reset(self) -> None:
        """Have nothing to forget."""
