"""Labels: what people or programs say is in a recording. Readers of every form, behind one table."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from seaclutter_cli.errors import LabelError
from seaclutter_cli.interfaces import Labels
from seaclutter_cli.labels import csv, in_cloud, seepersea, semantickitti, sustechpoints
from seaclutter_cli.labels.options import LabelOptions

__all__ = ["LABELS", "LabelForm", "LabelOptions", "open_labels"]


@dataclass(frozen=True)
class LabelForm:
    """A form in which labels come.

    Parameters
    ----------
    title : str
        What it is, for people.
    matches : callable
        Tells whether a path that exists holds labels of this form, by what is in it.
    open : callable
        Opens a path that matches; raises `LabelError`.
    """

    title: str
    matches: Callable[[Path], bool]
    open: Callable[[Path, LabelOptions], Labels]


LABELS: Mapping[str, LabelForm] = {
    "csv": LabelForm(f"a CSV file with the columns {','.join(csv.COLUMNS)}", csv.matches, csv.open_csv),
    "seepersea": LabelForm("a SeePerSea sequence with annotations/*.json", seepersea.matches, seepersea.open_seepersea),
    "sustechpoints": LabelForm(
        "a SUSTechPOINTS scene with label/*.json", sustechpoints.matches, sustechpoints.open_sustechpoints
    ),
    "semantickitti": LabelForm(
        "a SemanticKITTI folder of .label files", semantickitti.matches, semantickitti.open_semantickitti
    ),
    "cloud": LabelForm(
        "a log whose clouds have a field 'label' (.mcap, .bag, rosbag2)", in_cloud.matches, in_cloud.open_in_cloud
    ),
}
"""Forms of labels by name. A new one is one line here."""


def open_labels(path: Path, options: LabelOptions = LabelOptions()) -> Labels:  # noqa: B008 - it is frozen
    """Open labels of one recording, in the form that the content of the path shows.

    What comes back sees the frames of one topic, in order. Ask it for the truth of a frame as often as needed.

    Parameters
    ----------
    path : Path
        File or folder.
    options : LabelOptions, optional
        How labels are read.

    Raises
    ------
    LabelError
        If there is nothing, nothing that is known, or labels of several forms; or if they cannot be read.
    """
    try:
        if not path.exists():
            raise LabelError(f"{path}: there is no such file or folder")
        found = _forms_of(path)
        if len(found) == 1:
            return found[0].open(path, options)
    except OSError as error:
        raise LabelError(f"{path}: {error.strerror}") from error
    if found:
        raise LabelError(f"{path}: labels of several forms ({_listed(found)}); name the folder or file of one")
    raise LabelError(f"{path}: no labels that can be read; these can be: {_listed(LABELS.values())}")


def _forms_of(path: Path) -> list[LabelForm]:
    """Return the forms that a path has; labels that lie beside a log, in its folder, go before those inside it."""
    found = {name: form for name, form in LABELS.items() if form.matches(path)}
    if len(found) > 1:
        found.pop("cloud", None)
    return list(found.values())


def _listed(forms: Iterable[LabelForm]) -> str:
    return "; ".join(form.title for form in forms)
