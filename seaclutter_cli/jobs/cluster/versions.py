"""The versions of the software of a cluster, on which outputs depend."""

import re
from collections.abc import Callable, Mapping
from importlib.metadata import PackageNotFoundError, requires
from typing import Any

from seaclutter_cli.registry import plugins

_NOT_COMPUTING = {"click", "lazy-loader", "tqdm", "annotated-types"}
_REMOTE = ("seaclutter", "python", "dask", "distributed", "cloudpickle")
_OPTIONAL = ("laspy", "lazrs", "obstore", "onnxruntime", "scikit-learn", "skops", "velodyne-decoder")


def compared_packages() -> list[str]:
    """Return the packages whose versions must be the same here and on workers."""
    try:
        stated = requires("seaclutter") or []
    except PackageNotFoundError:  # runs from its source
        stated = []
    names = [re.split(r"[^\w.-]", text, maxsplit=1)[0] for text in stated if "extra ==" not in text]
    added = {point.dist.name: None for points in plugins().values() for point in points if point.dist}
    return [*(name for name in names if name not in _NOT_COMPUTING), *added]


def skew(here: Mapping[str, Any] | None, there: Mapping[str, Any] | None, *, of_scheduler: bool = False) -> str | None:
    """Return the first difference between versions that matters, as ``has numpy 2.1, here 2.2``; None if there is none.

    Versions are as Dask collects them: ``{"packages": {name: version or None}}``. Those ``of_scheduler`` matter less,
    since it only passes tasks on.
    """
    ours, theirs = _packages(here), _packages(there)
    required = _REMOTE if of_scheduler else (*_REMOTE, *compared_packages())
    for name in dict.fromkeys((*required, *(() if of_scheduler else _OPTIONAL))):
        own, other = ours.get(name), theirs.get(name)
        if own is None or own == other or (other is None and name not in required):
            continue
        return f"has {name} {other}, here {own}" if other else f"has no {name}, here {own}"
    return None


def versions_question() -> tuple[Callable[[list[str]], Any], list[str]]:
    """Return a function of Dask and its argument, which give versions also where seaclutter is missing."""
    from distributed.versions import get_versions

    return get_versions, [*_REMOTE, *compared_packages(), *_OPTIONAL]


def _packages(found: Mapping[str, Any] | None) -> dict[str, str | None]:
    packages = dict((found or {}).get("packages", {}))
    if packages.get("python"):  # what patch releases change does not matter
        packages["python"] = ".".join(packages["python"].split(".")[:2])
    return packages
