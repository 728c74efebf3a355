"""Trained forests as files that load without running code."""

import json
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from seaclutter_cli import __version__
from seaclutter_cli.airborne.settings import TileSettings, parse_settings
from seaclutter_cli.errors import ConfigError, InputError, MissingExtraError, RenamedKeyWarning

_FORMAT = 1
_TRUSTED = ["sklearn.tree._tree.Tree"]  # compiled arrays of nodes, which are checked
_KEYS = {"format", "version", "settings", "features", "classes", "forest"}


@dataclass(frozen=True)
class ObjectModel:
    """A forest with what it was made for.

    Parameters
    ----------
    settings : TileSettings
        That it was trained with.
    forest : sklearn.ensemble.RandomForestClassifier
        Its ``classes_`` are codes of classes.
    """

    settings: TileSettings
    forest: Any

    def to_bytes(self) -> bytes:
        """Return the model as a file's content: arrays and plain values, packed by skops.

        Raises
        ------
        MissingExtraError
            If skops is not installed.
        """
        from zipfile import ZIP_DEFLATED

        content = {
            "format": _FORMAT,
            "version": __version__,
            "settings": json.dumps(self.settings.as_dict()),
            "features": list(self.settings.features.names),
            "classes": [int(code) for code in self.forest.classes_],
            "forest": self.forest,
        }
        return bytes(_skops().dumps(content, compression=ZIP_DEFLATED, compresslevel=6))


def load_model(path: Path) -> ObjectModel:
    """Return the model in a file.

    Nothing in the file is run: it is refused if it names any type but the trees of scikit-learn and those that skops
    knows as safe, and if a tree's nodes do not follow each other.

    Raises
    ------
    InputError
        If it is no such model, or one for other features than this version computes.
    MissingExtraError
        If scikit-learn or skops is not installed.
    """
    io = _skops()
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from error
    try:
        foreign = sorted(set(io.get_untrusted_types(data=data)) - set(_TRUSTED))
        content = None if foreign else io.loads(data, trusted=_TRUSTED)
        model = None if foreign else _checked(content)
    except Exception as error:
        text = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: no model of seaclutter ({text[:200]})") from error
    if model is None:
        raise InputError(f"{path}: refused, it names types that are no part of a model: {', '.join(foreign)}")
    return model


def _checked(content: Any) -> ObjectModel:
    from sklearn.ensemble import RandomForestClassifier

    if not isinstance(content, dict) or set(content) != _KEYS or content["format"] != _FORMAT:
        raise ValueError("it does not hold what a model does")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RenamedKeyWarning)  # nobody wrote them by hand
            settings = parse_settings(json.loads(content["settings"]), "its settings")
    except ConfigError as error:
        raise ValueError(str(error)) from error
    names, forest = list(settings.features.names), content["forest"]
    if content["features"] != names:
        raise ValueError(f"it is for other features: {', '.join(map(str, content['features']))}")
    if type(forest) is not RandomForestClassifier or forest.n_features_in_ != len(names):
        raise ValueError("its forest is for another number of features")
    if [int(code) for code in forest.classes_] != content["classes"] or forest.n_outputs_ != 1:
        raise ValueError("its forest is for other classes")
    for tree in forest.estimators_:
        _check_tree(tree.tree_, len(names), len(content["classes"]))
    return ObjectModel(settings, forest)


def _check_tree(tree: Any, features: int, classes: int) -> None:
    """Check that every branch ends, and within the arrays: compiled code follows them unchecked."""
    left, right, count = tree.children_left, tree.children_right, tree.node_count
    leaf = left == -1
    here = np.arange(count)
    sound = all(((side[~leaf] > here[~leaf]) & (side[~leaf] < count)).all() for side in (left, right))
    sound &= bool((right[leaf] == -1).all()) and count > 0 and tree.value.shape == (count, 1, classes)
    sound &= bool(((tree.feature[~leaf] >= 0) & (tree.feature[~leaf] < features)).all())
    if not sound or tree.n_features != features:
        raise ValueError("a tree is damaged")


def _skops() -> Any:
    try:
        import sklearn.ensemble  # noqa: F401 - an extra, as skops is
        import skops.io
    except ImportError as error:
        raise MissingExtraError("classification", "classify") from error
    return skops.io
