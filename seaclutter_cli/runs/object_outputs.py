"""Checks of outputs in object storage, before anything is read or written."""

from collections.abc import Mapping, Sequence

from seaclutter_cli.errors import UsageError
from seaclutter_cli.storage.locations import Location, Url
from seaclutter_cli.storage.objects import exists, is_folder_of_objects, list_folder

Given = Sequence[tuple[str, Location]]
"""Options and the places that they give."""


def is_object_folder(url: Url) -> bool:
    """Return whether an output without a slash at its end means a folder, because it is one."""
    return not url.key or (not exists(url) and is_folder_of_objects(url))


def check_objects(
    outputs: Given, inputs: Given, labels: Sequence[Location], *, force: bool, markers: Mapping[str, str]
) -> None:
    """Check the outputs in object storage; see `prepare_outputs`.

    Raises
    ------
    UsageError
        If two outputs are the same object, or an output is an input, is inside an input folder, is a bucket or a
        folder, or exists and may not be replaced.
    InputError
        If there is no such bucket, or no access.
    """
    targets: dict[Url, str] = {}
    for option, url in outputs:
        if not isinstance(url, Url):
            continue
        if not url.key:
            raise UsageError(f"{url}: is a bucket; {option} takes an object")
        if url in targets:
            raise UsageError(f"{url}: is given for two outputs, {targets[url]} and {option}")
        targets[url] = option
    known = {folder: list_folder(folder) for folder in {url.parent for url in targets}}
    for url, option in targets.items():
        if outer := next((targets[above] for above in _above(url) if above in targets), None):
            raise UsageError(f"{url}: is in a folder that is given for a file, {outer}; choose another for {option}")
        _check_apart(url, option, inputs)
        objects, folders = known[url.parent]
        if url in objects:
            _check_apart(url, option, [("--labels", label) for label in labels])
            if not force:
                raise UsageError(f"{url}: already exists; use --force to replace it")
        elif url in folders:
            _check_folder(url, option, markers.get(option, ""), force=force)


def _check_folder(url: Url, option: str, marker: str, *, force: bool) -> None:
    if not marker:
        raise UsageError(f"{url}: is a folder; {option} takes a file")
    if not exists(url / marker):
        problem = f"is a folder without {marker}, so it is incomplete or of something else"
        raise UsageError(f"{url}: {problem}; delete it, or choose another output for {option}")
    if not force:
        raise UsageError(f"{url}: already exists; use --force to replace it")


def _check_apart(url: Url, option: str, inputs: Given) -> None:
    for source, place in inputs:
        if isinstance(place, Url) and (place == url or place in _above(url) or url in _above(place)):
            raise UsageError(f"{url}: is part of the input, {source}; choose another output for {option}")


def _above(url: Url) -> list[Url]:
    """Return the folders that contain an object, without the bucket."""
    folders = []
    while (url := url.parent).key:
        folders.append(url)
    return folders
