"""User settings of the label readers."""

from dataclasses import dataclass

from seaclutter_cli.frame import Frame


@dataclass(frozen=True, kw_only=True)
class LabelOptions:
    """Settings of the label readers.

    Parameters
    ----------
    clutter_ids : tuple of int
        Classes of per-point labels that are clutter; they take precedence over ``ignore_ids``.
    ignore_ids : tuple of int
        Classes of per-point labels that are neither clutter nor targets.
    by_sequence : bool
        Whether a frame's number is the ``sequence`` of its message, not its ``index``. Folders of frames need this:
        a damaged file is left out of the stream but keeps its number.
    """

    clutter_ids: tuple[int, ...] = (110,)
    ignore_ids: tuple[int, ...] = (0, 99)
    by_sequence: bool = False

    def number(self, frame: Frame) -> int:
        """Return the number of a frame in the labels, from 0."""
        return frame.message.sequence if self.by_sequence and frame.message else frame.index
