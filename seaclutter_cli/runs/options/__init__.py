"""Options that several use cases share: what is read, how several recordings are processed, methods, and labels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from seaclutter_cli.errors import ConfigError
from seaclutter_cli.options import (
    Anything,
    Converted,
    Kind,
    Number,
    OptionalPath,
    Options,
    Parsed,
    Place,
    Whole,
    option,
    optional,
)
from seaclutter_cli.runs.observer import SILENT, Observer, raising
from seaclutter_cli.urls import PathLike, is_url, place

if TYPE_CHECKING:
    from seaclutter_cli.config import Config, ConfigSource
    from seaclutter_cli.selection import Moment, Selection

MethodLike = Any
"""A method by its name, or a class, an object or a function; see `Filter`."""

WORKING_CONFIG = "seaclutter.yaml"
"""Configuration that the command line uses if it is in the working folder."""


class Places(Anything):
    """Paths, patterns and URLs of inputs, which stay as they are given; a single one need not be in a sequence."""

    def check(self, value: Any, name: str) -> Any:  # noqa: ARG002
        """Return the value."""
        for one in value if isinstance(value, Sequence) and not isinstance(value, str) else [value]:
            place(one)
        return value


class _Time(Kind):
    """Times that `Selection` takes."""

    def check(self, value: Any, name: str) -> Any:
        return value if hasattr(value, "utcoffset") else Number().check(value, name)


_TIME = Parsed("selection.parse_moment", _Time())


class Decoding(Options):
    """How recordings are decoded."""

    place = 1

    rate_hz: float = option(
        "--rate HZ", "Frames per second of recordings without time stamps.", default=10.0, kind=Number(0, above=True)
    )
    calibration: OptionalPath = optional(
        "--calibration", "Angles or metadata of the sensor, for packets that lack them.", kind=Place()
    )
    sensor: str | None = optional(
        "--sensor MODEL",
        "Sensor model, for packets that do not identify it.",
        kind=Parsed("sensors.catalog.known_sensor"),
    )
    columns: str | None = optional(
        "--columns NAMES",
        "Columns of files that do not name theirs (BIN, NPY, CSV), such as x,y,z,intensity,ring; types after colons, "
        "as in x,y,z:f8,intensity:u2. [default: of BIN, the only known layout that fits]",
        kind=Parsed("sources.frame_files.headerless.known_columns"),
    )
    integrate_ms: float | None = optional(
        "--integrate MS",
        "Join the clouds of each MS milliseconds into one frame, for lidars whose scans do not repeat.",
        kind=Number(1, 2000),
    )

    def beside(self) -> tuple[Path, ...]:
        """Return the files that are read with each recording."""
        return (self.calibration,) if self.calibration else ()


class ReadOptions(Decoding):
    """Part of each recording to read, and how."""

    place = 1

    topics: Converted[str | Sequence[str], tuple[str, ...]] = option(
        "-t --topic NAME", "Point-cloud topic, if there are several; repeatable.", default=()
    )
    start_s: Moment | None = optional(
        "--start TIME",
        "Start at TIME: seconds from the start of the recording, ISO 8601 (UTC), or seconds since 1970.",
        kind=_TIME,
    )
    end_s: Moment | None = optional("--end TIME", "Stop before TIME.", kind=_TIME)
    frames: int | None = optional("-n --frames", "Stop after N frames of each topic.", kind=Whole(1))
    intensity_field: str | None = optional("--intensity-field NAME", "Intensity field, if it has no usual name.")
    join: bool | None = optional(
        "--join/--no-join",
        "Read the numbered files of a folder as one recording, or one by one. "
        "[default: as one if each begins where the one before ends]",
    )
    merge: bool = optional(
        "--merge",
        "Read all logs as one recording, by time; a topic that several have gets the name of its log before its own.",
    )
    recursive: bool = optional("--recursive", "Also search subfolders for recordings.")

    @property
    def reading(self) -> ReadOptions:
        """These options alone."""
        return self.part(ReadOptions())

    @property
    def selection(self) -> Selection:
        """Selected part of each recording."""
        from seaclutter_cli.selection import Selection

        return Selection(
            topics=self.topics,
            start_s=self.start_s,
            end_s=self.end_s,
            frames=self.frames,
            intensity_field=self.intensity_field,
        )


class Observed(Options):
    """What every function takes that reports progress."""

    observer: Observer = option("", "Receives progress and warnings.", default=SILENT, kind=Anything(is_place=True))

    def __getstate__(self) -> dict[str, Any]:
        """Return the options without inputs and observer, which other processes do not need."""
        return {**vars(self), **{name: () for name in ("logs", "tiles") if name in vars(self)}, "observer": SILENT}


class OfLogs(ReadOptions, Observed):
    """What every function for logs takes."""

    writes_remotely = True

    logs: PathLike | Sequence[PathLike] = option(
        "LOGS...", "Files, folders or globs of logs, or URLs of objects.", kind=Places(is_place=True), kw_only=False
    )
    keep_going: bool = optional(
        "", "Store the error of a recording in its outcome and continue with the others, instead of raising it."
    )

    @property
    def watching(self) -> Observer:
        """The observer; it raises errors of recordings, unless the run is to continue."""
        return self.observer if self.keep_going else raising(self.observer)


def _jobs(text: str) -> int | None:
    if text == "auto":
        return None
    if not (text.isascii() and text.isdigit() and len(text) <= 4 and int(text)):
        raise ValueError("expected a positive whole number or auto")
    return int(text)


class BatchOptions(Options):
    """How several recordings are processed. Results do not depend on it.

    A script that uses several processes needs ``if __name__ == "__main__":``, as for `multiprocessing`.
    """

    place = 3

    jobs: int | None = option(
        "-j --jobs N",
        "Process N recordings at the same time. [default: as many as there are cores and memory for]",
        default=1,
        of_command=None,
        kind=Parsed(_jobs, Whole(1)),
    )
    fail_fast: bool = optional("--fail-fast", "Stop after the first recording with an error.")
    resume: bool = optional(
        "--resume", "Skip recordings whose output of the same run is complete; replace outputs of other runs."
    )
    manifest: OptionalPath = optional("--manifest", "Write a table with a row for each recording (CSV or JSON).")
    cluster: str | None = optional(
        "--cluster ADDRESS",
        "Process recordings on the workers of a Dask cluster: tls://HOST:PORT, or slurm to start -j N workers.",
    )
    cluster_insecure: bool = optional("--cluster-insecure", "Allow a cluster without encryption, tcp://HOST:PORT.")

    def runs_here(self, recordings: int) -> bool:
        """Return whether the work is on a single recording, in this process."""
        return recordings == 1 and self.cluster is None


class Replacing(Options):
    """Whether outputs may replace files."""

    force: bool = optional("--force", "Replace existing output files.")

    @property
    def replaces(self) -> bool:
        """Whether outputs may replace files: of an earlier run if this one resumes it, too."""
        return self.force or vars(self).get("resume", False)


class _Ids(Kind):
    """Whole numbers, on the command line separated by commas."""

    def parse(self, text: str) -> Any:
        try:
            return tuple(int(number) for number in text.split(",") if number.strip())
        except ValueError as error:
            raise ValueError("expected whole numbers separated by commas, such as 0,99") from error

    def check(self, value: Any, name: str) -> Any:
        return Whole().check_all(value, name)


LABELS_HELP = "Labels of LOGS in the same order, or a folder with RECORDING.labels.csv for each; repeatable."


class LabelSources(Options):
    """Labels of recordings, and how to read them."""

    labels: Converted[PathLike | Sequence[PathLike] | None, tuple[Path, ...]] = option(
        "--labels LABELS", LABELS_HELP, default=(), kind=Place(remote=True)
    )
    clutter_ids: Converted[Sequence[int] | None, tuple[int, ...] | None] = optional(
        "--clutter-ids IDS", "Class ids of clutter in point labels, such as 110,111. [default: 110]", kind=_Ids()
    )
    ignore_ids: Converted[Sequence[int] | None, tuple[int, ...] | None] = optional(
        "--ignore-ids IDS", "Class ids to ignore in point labels. [default: 0,99]", kind=_Ids()
    )


class OfLabelledLogs(LabelSources, OfLogs):
    """What every function for labelled logs takes."""

    labels: Converted[PathLike | Sequence[PathLike], tuple[Path, ...]] = option(
        "--labels LABELS", LABELS_HELP, kind=Place(remote=True), repeatable=True, kw_only=False
    )


class ConfigFile(Kind):
    """Configurations: files, names of built-in ones, contents of files, and objects of class `Config`."""

    is_place = True

    def check(self, value: Any, name: str) -> Any:
        """Return a configuration, with a path or name as a location; a path of a class of its own stays one."""
        if not (isinstance(value, str) or hasattr(value, "__fspath__")):
            return value
        found = Place(remote=True).check(value, name)
        return value if isinstance(value, Path) and not is_url(found) else found


class Settings(Kind):
    """Settings in the form of the command line, or keys and values."""

    def check_all(self, values: Any, name: str) -> Any:
        """Return settings in the form of the command line."""
        if not isinstance(values, Mapping):
            return super().check_all(values, name)
        return tuple(f"{key}={_as_yaml(value, key)}" for key, value in values.items())


def _as_yaml(value: Any, key: str) -> str:
    """Return a value as on the command line; raise `ConfigError` if it can be none in a configuration."""
    from yaml import YAMLError

    from seaclutter_cli.validation import yaml_value

    try:
        return yaml_value(value.tolist() if hasattr(value, "tolist") else value)
    except YAMLError as error:
        raise ConfigError(f"{key}: not a value of a configuration: {value!r}") from error


class _Configured(Options):
    config: Converted[PathLike | Mapping[str, Any] | Config | None, ConfigSource | None] = optional(
        "-c --config FILE",
        "Configuration file, or the name of a built-in one. "
        f"[default: {WORKING_CONFIG} in the working folder, if there is one; - is standard input]",
        kind=ConfigFile(),
    )
    settings: Converted[Sequence[str] | Mapping[str, Any], tuple[str, ...]] = option(
        "-s --set KEY=VALUE", "Set a key, such as filter.start_m=5; repeatable.", default=(), kind=Settings()
    )


class MethodName(Kind):
    """Methods: names, classes, objects, functions, and classes in files by ``FILE.py:CLASS``."""

    def check(self, value: Any, name: str) -> Any:  # noqa: ARG002 - errors name the method
        """Return the name of a method; raise `ConfigError` if it is none."""
        from seaclutter_cli.given import method_of

        return method_of(value)


class ConfigOptions(_Configured):
    """Sources of the configuration of a run, in ascending precedence: file, method, single keys."""

    method: Converted[MethodLike | None, str | None] = optional(
        "-m --method NAME",
        "Filter method, or FILE.py:CLASS for one of your own; overrides the configuration.",
        kind=MethodName(),
    )


class MethodOptions(_Configured):
    """Methods that a run compares, and the sources of their configurations."""

    methods: Converted[MethodLike | Sequence[MethodLike], tuple[str, ...]] = option(
        "-m --method NAME",
        "Filter method, or FILE.py:CLASS for one of your own, by default that of the configuration; none leaves the "
        "logs unfiltered; repeatable.",
        default=(),
        kind=MethodName(),
    )
    compare: Converted[
        Literal["paper", "peers", "all"] | Sequence[Literal["paper", "peers", "all"]], tuple[str, ...]
    ] = option(
        "--compare",
        "Compare the stages of joint as in its paper; joint, confirmed and their peers; or all and none.",
        default=(),
    )
