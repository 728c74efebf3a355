"""Trained forests: classification of tiles with them, and their files, which load without running code."""

import io
import json
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

import numpy as np

from seaclutter_cli import __version__
from seaclutter_cli.airborne.features import NonSeaPoints, features_of
from seaclutter_cli.airborne.forest import predict
from seaclutter_cli.airborne.objects import FoundObject, find_objects
from seaclutter_cli.airborne.separation import Separation, separate
from seaclutter_cli.airborne.settings import TileSettings, parse_settings
from seaclutter_cli.arrays import Floats, Ints
from seaclutter_cli.documents import load_json
from seaclutter_cli.errors import ConfigError, InputError, RenamedKeyWarning, opening, requiring
from seaclutter_cli.interfaces import TilePoints
from seaclutter_cli.paths import read_whole

_FORMAT = 1
_TRUSTED = ["sklearn.tree._tree.Tree"]  # compiled arrays of nodes, checked in _check_tree
_SCHEMA = "schema.json"
_ADDRESS = re.compile(r'("__id__": |"file": ")(\d+)')
_MAX_UNPACKED_BYTES = 64 * 2**20
_MAX_RATIO = 50
"""Files may unpack to the larger of this size and this multiple of their own; trees shrink to a fifth by packing."""
_KEYS = {"format", "version", "settings", "features", "classes", "forest"}


def tile_features(tile: TilePoints, settings: TileSettings) -> tuple[Separation, NonSeaPoints, Floats]:
    """Return a separated tile, its N non-sea points, and their features, shape (N, F); missing intensities count as 0.

    Raise `InputError` if the tile cannot be separated.
    """
    separation = separate(tile, settings.separation, tile.column)
    other = separation.other
    xy = np.concatenate([xyz[:2] for xyz in tile], axis=1)[:, other]
    intensity = tile.column("intensity")
    bright = np.zeros(len(other)) if intensity is None else intensity[other].astype(np.float64)
    density = separation.points_per_cell / settings.separation.cell_m**2
    least_m = separation.sea.object_height_m
    points = NonSeaPoints(xy, separation.height_m[other].astype(np.float64), bright, density, least_m)
    return separation, points, features_of(points, settings.features)


@dataclass(frozen=True)
class ClassifiedPoints:
    """Classes and objects of the N non-sea points of a tile.

    ``separation``: the separated tile; ``xy``, shape (2, N): positions of the points in metres; ``code``, shape (N,):
    class of each point; ``probability``, shape (N,): probability of that class; ``number``, shape (N,): object of each
    point; 0 for none; ``left_out``, shape (N,): cluster of each point if it is too unlikely to be an object; 0 for
    none; ``objects``: objects found in the tile.
    """

    separation: Separation
    xy: Floats
    code: Ints
    probability: Floats
    number: Ints
    left_out: Ints
    objects: list[FoundObject]


def classify_points(tile: TilePoints, model: "ObjectModel") -> ClassifiedPoints:
    """Return the classes and objects of a tile; raise `InputError` if it cannot be separated."""
    separation, points, features = tile_features(tile, model.settings)
    probability = predict(model.forest, features)
    classes = [int(code) for code in model.forest.classes_]
    objects, number, left_out = find_objects(points, probability, classes, model.settings.objects)
    code = np.array(classes)[probability.argmax(axis=1)] if len(probability) else np.empty(0, np.int64)
    likely = probability.max(axis=1, initial=0.0)
    return ClassifiedPoints(separation, points.xy, code, likely, number, left_out, objects)


@dataclass(frozen=True)
class ObjectModel:
    """A trained forest and its settings.

    ``settings``: settings of the training; ``forest``: the forest; its ``classes_`` are class codes; ``warnings``,
    optional: warnings about the file of the model.
    """

    settings: TileSettings
    forest: Any
    warnings: tuple[str, ...] = ()

    def to_bytes(self) -> bytes:
        """Return the content of a model file: arrays and plain values, packed by skops; the same for the same model.

        Raise `MissingExtraError` if skops is not installed.
        """
        content = {
            "format": _FORMAT,
            "version": __version__,
            "settings": json.dumps(self.settings.as_dict()),
            "features": list(self.settings.features.names),
            "classes": [int(code) for code in self.forest.classes_],
            "forest": self.forest,
        }
        return _reproducible(_skops().dumps(content))


def load_model(path: Path) -> ObjectModel:
    """Return the model in a file.

    Nothing in the file is run. A file is refused if it contains any type other than the trees of scikit-learn and
    those that skops trusts, or if the nodes of a tree are inconsistent.

    Raise `InputError` if the file is not such a model, or the model was trained with features that this version does
    not compute, and `MissingExtraError` if scikit-learn or skops is not installed.
    """
    with opening(path, problem="cannot be read"):
        data = read_whole(path)
    skops = _skops()
    try:
        _check_size(data)
        foreign = sorted(set(skops.get_untrusted_types(data=data)) - set(_TRUSTED))
        if not foreign:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                content = skops.loads(data, trusted=_TRUSTED)
            return _checked(content, _explain(caught))
    except Exception as error:
        text = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{path}: not a seaclutter model ({text[:200]})") from error
    raise InputError(f"{path}: refused; it contains types that are not part of a model: {', '.join(foreign)}")


def _explain(caught: Sequence[warnings.WarningMessage]) -> tuple[str, ...]:
    """Return the warnings of libraries in the program's own words, each once; those about versions only."""
    versions = {str(getattr(warning.message, "original_sklearn_version", "")) for warning in caught} - {""}
    return tuple(
        f"the model was trained with scikit-learn {version}, not the installed version; its results may differ"
        for version in sorted(versions)
    )


def _checked(content: Any, notes: tuple[str, ...]) -> ObjectModel:
    from sklearn.ensemble import RandomForestClassifier

    if not isinstance(content, dict) or set(content) != _KEYS or content["format"] != _FORMAT:
        raise ValueError("unexpected content")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RenamedKeyWarning)  # not written by the user
            settings = parse_settings(load_json(content["settings"]), "its settings")
    except ConfigError as error:
        raise ValueError(str(error)) from error
    names, forest = list(settings.features.names), content["forest"]
    if content["features"] != names:
        raise ValueError(f"its features differ: {', '.join(map(str, content['features']))}")
    if type(forest) is not RandomForestClassifier or forest.n_features_in_ != len(names):
        raise ValueError(f"its forest is not a random forest of {len(names)} features")
    if [int(code) for code in forest.classes_] != content["classes"] or forest.n_outputs_ != 1:
        raise ValueError("its forest has other classes")
    for tree in forest.estimators_:
        _check_tree(tree.tree_, len(names), len(content["classes"]))
    if forest.predict_proba(np.zeros((1, len(names)), np.float32)).shape != (1, len(content["classes"])):
        raise ValueError("its forest does not predict its classes")
    return ObjectModel(settings, forest, notes)


def _check_tree(tree: Any, features: int, classes: int) -> None:
    """Check that every branch ends within the arrays; compiled code follows the nodes unchecked."""
    left, right, count = tree.children_left, tree.children_right, tree.node_count
    leaf = left == -1
    here = np.arange(count)
    valid = all(((side[~leaf] > here[~leaf]) & (side[~leaf] < count)).all() for side in (left, right))
    valid &= bool((right[leaf] == -1).all()) and count > 0 and tree.value.shape == (count, 1, classes)
    valid &= bool(((tree.feature[~leaf] >= 0) & (tree.feature[~leaf] < features)).all())
    if not valid or tree.n_features != features:
        raise ValueError("a tree is damaged")


def _skops() -> Any:
    with requiring("classification", "classify"):
        import sklearn.ensemble  # noqa: F401 - an optional dependency, like skops
        import skops.io
    return skops.io


def _check_size(data: bytes) -> None:
    """Raise `ValueError` if a file would unpack to more than the size of any model."""
    with ZipFile(io.BytesIO(data)) as archive:
        unpacked = sum(member.file_size for member in archive.infolist())
    if unpacked > max(_MAX_UNPACKED_BYTES, _MAX_RATIO * len(data)):
        raise ValueError(f"{len(data):,} bytes that unpack to {unpacked:,}")


def _reproducible(data: bytes) -> bytes:
    """Return a file whose bytes depend on its content only.

    skops names arrays and objects by their addresses in memory and writes the time; the spare bytes between the columns
    of an array of records are whatever the memory held.
    """
    numbers: dict[str, int] = {}

    def by_number(found: re.Match[str]) -> str:
        return f"{found[1]}{numbers.setdefault(found[2], len(numbers) + 1)}"

    packed = io.BytesIO()
    with ZipFile(io.BytesIO(data)) as source, ZipFile(packed, "w") as target:
        schema = _ADDRESS.sub(by_number, source.read(_SCHEMA).decode())
        for name in source.namelist():
            stem, _, suffix = name.partition(".")
            is_schema = name == _SCHEMA
            member = ZipInfo(name if is_schema else f"{numbers[stem]}.{suffix}")  # of the year 1980
            member.create_system = 3  # Unix, also on Windows
            member.external_attr = 0o600 << 16
            content = schema.encode() if is_schema else _without_spare_bytes(source.read(name))
            target.writestr(member, content, ZIP_DEFLATED, 6)
    return packed.getvalue()


def _without_spare_bytes(array_file: bytes) -> bytes:
    array = np.load(io.BytesIO(array_file), allow_pickle=False)
    if not array.dtype.names:
        return array_file
    clean = np.zeros(array.shape, array.dtype)
    for name in array.dtype.names:
        clean[name] = array[name]
    written = io.BytesIO()
    np.save(written, clean, allow_pickle=False)
    return written.getvalue()
