"""Readers of ground-truth labels of recordings, in several formats."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from seaclutter_cli.errors import LabelError, opening
from seaclutter_cli.interfaces import Labels
from seaclutter_cli.labels import csv
from seaclutter_cli.labels.boxes import LabelOptions
from seaclutter_cli.labels.json_boxes import SEEPERSEA, SUSTECHPOINTS, AutoferryLabels, find_scenario
from seaclutter_cli.labels.point_labels import CloudLabels, find_log, find_semantickitti, open_semantickitti
from seaclutter_cli.registry import Registry

__all__ = ["LABELS", "LabelFormat", "LabelOptions", "has_labels", "open_labels"]


@dataclass(frozen=True)
class LabelFormat:
    """Label format: its description, what of an existing path has it (None for nothing), and its reader."""

    title: str
    find: Callable[[Path], Any]
    open: Callable[[Any, LabelOptions], Labels]


_BUILT_IN: Mapping[str, LabelFormat] = {
    "csv": LabelFormat(f"a CSV file with the columns {','.join(csv.COLUMNS)}", csv.find, csv.CsvLabels),
    "seepersea": LabelFormat("a SeePerSea sequence with annotations/*.json", SEEPERSEA.find, SEEPERSEA.open),
    "sustechpoints": LabelFormat("a SUSTechPOINTS scene with label/*.json", SUSTECHPOINTS.find, SUSTECHPOINTS.open),
    "semantickitti": LabelFormat("a SemanticKITTI folder of .label files", find_semantickitti, open_semantickitti),
    "autoferry": LabelFormat(
        "a scenario of the Autoferry sensor fusion data set with *_groundTruth.json and *_detections.json",
        find_scenario,
        AutoferryLabels,
    ),
    "cloud": LabelFormat("a log whose clouds have a field 'label' (.mcap, .bag, rosbag2)", find_log, CloudLabels),
}
"""Label formats by name. A new format takes one line here."""


def _of_plugin(name: str, form: LabelFormat) -> Mapping[str, LabelFormat]:
    if not isinstance(form, LabelFormat):
        raise TypeError("must be a LabelFormat")
    return {name: form}


LABELS = Registry("labels", _BUILT_IN, _of_plugin)
"""Label formats by name, those of plug-ins last."""


def has_labels(folder: Path) -> bool:
    """Return whether a folder of frames contains labels, too."""
    forms = (known for name, known in LABELS.items() if name not in ("csv", "cloud"))
    return any(known.find(folder) is not None for known in forms)


def open_labels(path: Path, options: LabelOptions = LabelOptions()) -> Labels:  # noqa: B008 - frozen
    """Return the labels of one recording; the content of the path, a file or folder, determines the format.

    The labels must receive the frames of one topic in order. The truth of a frame can be requested repeatedly.
    `LabelError` if the path does not exist, has no known format or several formats, or cannot be read.
    """
    with opening(path, LabelError):
        if not path.exists():
            raise LabelError(f"{path}: no such file or folder")
        places = {name: known.find(path) for name, known in LABELS.items()}
        found = {LABELS[name]: place for name, place in places.items() if place is not None}
        if len(found) > 1:  # labels in the folder of a log take precedence over those in its clouds
            found.pop(LABELS["cloud"], None)
        if len(found) == 1:
            ((known, place),) = found.items()
            return known.open(place, options)
    if found:
        raise LabelError(f"{path}: labels in several formats ({_listed(found)}); give the folder or file of one format")
    raise LabelError(f"{path}: no labels in a known format; known formats: {_listed(LABELS.values())}")


def _listed(formats: Iterable[LabelFormat]) -> str:
    return "; ".join(known.title for known in formats)
