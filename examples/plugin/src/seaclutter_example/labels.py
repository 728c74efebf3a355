"""Labels in a text: a line ``frame name x y z length width height`` for each box."""

from collections import defaultdict
from pathlib import Path

from seaclutter.plugins import Frame, LabelError, LabelFormat, Labelled, LabelOptions, Truth, truth_of


class TextLabels:
    """Boxes by the number of their frame."""

    def __init__(self, path: Path, options: LabelOptions) -> None:
        self._boxes: dict[int, list[Labelled]] = defaultdict(list)
        self._seen: set[int] = set()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            try:
                frame, name, *values = line.split()
                x, y, z, length, width, height = map(float, values)
            except ValueError as error:
                raise LabelError(f"{path}: line {number}: {error}") from error
            box = Labelled(name, "target", (x, y, z), (length, width, height), 0.0)
            self._boxes[int(frame)].append(box)

    def truth(self, frame: Frame) -> Truth | None:
        """Return the boxes of a frame."""
        self._seen.add(frame.index)
        return truth_of(self._boxes.get(frame.index, []))

    def finish(self) -> None:
        """Refuse labels of frames that do not exist."""
        if missing := set(self._boxes) - self._seen:
            raise LabelError(f"labels for frame {min(missing)}, which does not exist")


FORM = LabelFormat("a text NAME.boxes.txt", lambda path: path if path.name.endswith(".boxes.txt") else None, TextLabels)
