"""Readers of ground-truth labels of recordings, in several formats."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from seaclutter_cli.errors import LabelError
from seaclutter_cli.interfaces import Labels
from seaclutter_cli.labels import autoferry, csv, point_labels
from seaclutter_cli.labels.boxes import LabelOptions
from seaclutter_cli.labels.json_boxes import SEEPERSEA, SUSTECHPOINTS

__all__ = ["LABELS", "LabelFormat", "LabelOptions", "open_labels"]


@dataclass(frozen=True)
class LabelFormat:
    """Label format: its description, whether the content of an existing path has it, and its reader."""

    title: str
    matches: Callable[[Path], bool]
    open: Callable[[Path, LabelOptions], Labels]


LABELS: Mapping[str, LabelFormat] = {
    "csv": LabelFormat(f"a CSV file with the columns {','.join(csv.COLUMNS)}", csv.matches, csv.open_csv),
    "seepersea": LabelFormat("a SeePerSea sequence with annotations/*.json", SEEPERSEA.matches, SEEPERSEA.open),
    "sustechpoints": LabelFormat("a SUSTechPOINTS scene with label/*.json", SUSTECHPOINTS.matches, SUSTECHPOINTS.open),
    "semantickitti": LabelFormat(
        "a SemanticKITTI folder of .label files",
        lambda path: point_labels.find_semantickitti(path) is not None,
        point_labels.open_semantickitti,
    ),
    "autoferry": LabelFormat(
        "a scenario of the Autoferry sensor fusion data set with *_groundTruth.json and *_detections.json",
        autoferry.matches,
        autoferry.open_autoferry,
    ),
    "cloud": LabelFormat(
        "a log whose clouds have a field 'label' (.mcap, .bag, rosbag2)",
        point_labels.may_have_labels,
        point_labels.CloudLabels,
    ),
}
"""Label formats by name. A new format takes one line here."""


def open_labels(path: Path, options: LabelOptions = LabelOptions()) -> Labels:  # noqa: B008 - frozen
    """Return the labels of one recording; the content of the path, a file or folder, determines the format.

    The labels must receive the frames of one topic in order. The truth of a frame can be requested repeatedly.
    `LabelError` if the path does not exist, has no known format or several formats, or cannot be read.
    """
    try:
        if not path.exists():
            raise LabelError(f"{path}: no such file or folder")
        matching = {name: known for name, known in LABELS.items() if known.matches(path)}
        if len(matching) > 1:  # labels in the folder of a log take precedence over those in its clouds
            matching.pop("cloud", None)
        found = list(matching.values())
        if len(found) == 1:
            return found[0].open(path, options)
    except OSError as error:
        raise LabelError(f"{path}: {error.strerror}") from error
    if found:
        raise LabelError(f"{path}: labels in several formats ({_listed(found)}); give the folder or file of one format")
    raise LabelError(f"{path}: no labels in a known format; known formats: {_listed(LABELS.values())}")


def _listed(formats: Iterable[LabelFormat]) -> str:
    return "; ".join(known.title for known in formats)
