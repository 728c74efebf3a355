"""Checks of what methods, log formats, sensors, messages, labels and outputs of other packages must hold.

Each raises `AssertionError` that says what does not hold.
"""

import pickle
import tempfile
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from seaclutter_cli.api import filter_frames, open_log
from seaclutter_cli.cloud import Cloud, from_array
from seaclutter_cli.config import load_config
from seaclutter_cli.errors import CloudError, FieldError
from seaclutter_cli.frame import FilterResult, Frame, Reason
from seaclutter_cli.interfaces import CloudCodec, Filter
from seaclutter_cli.labels import open_labels
from seaclutter_cli.messages import CODECS
from seaclutter_cli.messages.definitions import ros2_schema
from seaclutter_cli.records import Channel, Message
from seaclutter_cli.runs.convert import convert_log
from seaclutter_cli.runs.options import ConfigOptions, MethodLike
from seaclutter_cli.sensors.packets import DecoderOptions, PacketFamily, PacketFrame, Packets
from seaclutter_cli.sources.formats import open_source
from seaclutter_cli.truth import Truth

_CLOUD = "sensor_msgs/msg/PointCloud2"
_SLACK_NS = 200_000_000
_POINT = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")])


def example_frames(count: int = 15, *, seed: int = 0) -> list[Frame]:
    """Return frames at 10 Hz: water and spray around a lidar, a hull that approaches, and invalid points.

    Some have no point, one point, or no valid one.
    """
    frames = []
    for index in range(count):
        random = np.random.default_rng((seed, index))
        n = (0, 1)[index % 7] if index % 7 < 2 and index > 1 else 600
        bearing, away = random.uniform(-np.pi, np.pi, n), random.uniform(3, 90, n)
        xyz = np.stack((away * np.cos(bearing), away * np.sin(bearing), random.normal(-2.5, 0.2, n)))
        hull = slice(0, n // 6)
        xyz[:, hull] = random.uniform((30 - index / 5, 4, -2.4), (34, 6, 0.5), (len(xyz[0, hull]), 3)).T
        points = np.zeros(n, _POINT)
        points["x"], points["y"], points["z"], points["intensity"] = *xyz, random.uniform(0, 120, n)
        if n > 1:
            points["x"][-20:] = np.nan
            points[-40:-20] = 0
        if index == count - 1:
            points["y"] = np.nan
        stamp_ns = 1_700_000_000_000_000_000 + index * 100_000_000
        cloud = from_array(points, stamp_ns=stamp_ns)
        channel = Channel(1, "/points", "cdr", ros2_schema(_CLOUD))
        message = Message(channel, stamp_ns, stamp_ns, index, CODECS[_CLOUD, "cdr"].encode(cloud))
        frames.append(Frame.of_message(message, cloud, index))
    return frames


def check_filter(method: MethodLike, frames: Sequence[Frame] | None = None, **parameters: Any) -> None:
    """Check a method on frames of one recording, by default those of `example_frames`.

    It must give each frame one result, in their order and no later than its look-ahead says, with a reason for each
    point; change no point; and give the same results again, after `reset`, and in another process.
    """
    frames = example_frames() if frames is None else frames
    options = ConfigOptions(method=method, settings={f"filter.{name}": value for name, value in parameters.items()})
    config = load_config(None, method=options.method, overrides=options.settings)
    before = [bytes(frame.cloud.data) for frame in frames]
    first = list(filter_frames(frames, config=config))
    assert [bytes(frame.cloud.data) for frame in frames] == before, "the method changes points"
    assert [one.frame for one in first] == list(frames), "not one result for each frame, in their order"
    for one in first:
        reason = one.reason
        assert reason.dtype == np.uint8, "reasons must be uint8"
        assert reason.shape == (one.frame.size,), "reasons must have shape (N,)"
        assert np.isin(reason, list(Reason)).all(), "a reason is none of Reason"
        assert not (one.frame.valid & np.equal(reason, Reason.INVALID)).any(), "a valid point has the reason INVALID"
    _require_same(first, filter_frames(frames, config=config), "another filter gives other results")
    sent = pickle.loads(pickle.dumps(config))  # noqa: S301 - of the line itself
    _require_same(first, filter_frames(frames, config=sent), "another process would give other results")
    used = config.make_filter()
    _in_time(used, frames)
    used.reset()
    _require_same(first, _in_time(used, frames), "results depend on what the filter saw before reset")
    bare = Frame.of_arrays(np.ones((3, 3)) * 20)
    with suppress(FieldError):  # if it needs intensities
        list(filter_frames([bare], config=config))


def _in_time(method: Filter, frames: Sequence[Frame]) -> list[FilterResult]:
    """Return the results of a filter; check that none waits longer than its look-ahead."""
    results: list[FilterResult] = []
    if method.needs_first_pass:
        for frame in frames:
            method.observe(frame)
    for number, frame in enumerate(frames):
        results += method.process(frame)
        if (missing := len(results)) <= number:
            waits_ns = frame.stamp_ns - frames[missing].stamp_ns
            assert waits_ns <= method.look_ahead_s * 1e9 + _SLACK_NS, "a result comes later than look_ahead_s says"
    return [*results, *method.flush()]


def _require_same(first: Iterable[FilterResult], again: Iterable[FilterResult], problem: str) -> None:
    for one, other in zip(first, again, strict=True):
        assert np.array_equal(one.reason, other.reason), problem


def check_source(path: Path) -> None:
    """Check a log: that it can be read again, in part, and converted, with the same clouds in the order of log time."""
    with closing(open_source(path)) as source:
        records = [record for record in source.records() if isinstance(record, Message)]
        times = [record.log_time_ns for record in records]
        assert times, "no messages"
        assert times == sorted(times), "messages are not in the order of log time"
        assert {record.channel for record in records} <= set(source.channels), "a channel is not known before reading"
        for channel, number in source.counts.items():
            assert number == sum(record.channel.id == channel for record in records), "counts are wrong"
        assert source.span_ns in (None, (times[0], times[-1])), "span_ns is wrong"
        again = [record for record in source.records() if isinstance(record, Message)]
        assert [bytes(one.data) for one in again] == [bytes(one.data) for one in records], "read again, it is different"
        middle = times[len(times) // 2]
        later = [record for record in source.records(middle) if isinstance(record, Message)]
        wanted = [bytes(record.data) for record in records if record.log_time_ns >= middle]
        kept = [bytes(record.data) for record in later if record.log_time_ns >= middle]
        assert kept == wanted, "the part from a time on is different"
        skipped = sum(source.skipped(middle).values())
        assert len(later) + skipped == len(records), "skipped does not say how many messages are left out"
    with tempfile.TemporaryDirectory() as folder:
        convert_log(path, Path(folder) / "copy.mcap")
        assert _points(Path(folder) / "copy.mcap") == _points(path), "converted to MCAP, its points are different"


def _points(log: Path) -> list[tuple[str, int, bytes]]:
    with open_log(log) as opened:
        return [(frame.topic, frame.stamp_ns, frame.xyz.tobytes()) for frame in opened.frames(opened.topics)]


def check_codec(codec: CloudCodec, message: bytes) -> None:
    """Check a codec on a valid message: that it decodes, encodes the same points, and refuses messages that are cut."""
    cloud = codec.decode(message)
    again = codec.decode(codec.encode(cloud))
    assert _columns(again) == _columns(cloud), "encoded and decoded, the points are different"
    assert (again.stamp_ns, again.frame_id) == (cloud.stamp_ns, cloud.frame_id), "time or frame id is lost"
    for end in range(0, len(message), max(1, len(message) // 200)):
        try:
            codec.decode(message[:end])
        except CloudError:
            continue
        raise AssertionError(f"a message that is cut after {end} bytes is not refused with CloudError")


def _columns(cloud: Cloud) -> dict[str, bytes]:
    points = cloud.points
    return {name: points[name].tobytes() for name in points.dtype.names or ()}


def check_packets(family: PacketFamily, payloads: NDArray[np.uint8], *, step_ns: int = 1_000_000) -> None:
    """Check a decoder on payloads, shape (P, L), of more than one revolution.

    It must recognise them and nothing else, give the same frames however they arrive, and count damaged ones.
    """
    assert all(map(family.recognises, payloads)), "a payload is not recognised"
    random = np.random.default_rng(0)
    for size in (0, 1, 100, payloads.shape[1]):
        assert not family.recognises(random.integers(0, 256, size, np.uint8)), "noise is recognised"
    packets = Packets(1_700_000_000_000_000_000 + step_ns * np.arange(len(payloads)), payloads)
    whole = _decoded(family, [packets])
    parts = _decoded(family, [packets[row : row + 1] for row in range(len(packets))])
    assert whole, "no frame"
    assert [frame.stamp_ns for frame in whole] == sorted(frame.stamp_ns for frame in whole), "stamps are not in order"
    assert _bytes_of(whole) == _bytes_of(parts), "frames depend on how packets are passed"
    damaged = payloads.copy()
    damaged[1::3] = random.integers(0, 256, damaged[1::3].shape, np.uint8)
    _decoded(family, [packets, Packets(packets.times_ns, damaged)])


def _decoded(family: PacketFamily, parts: Sequence[Packets]) -> list[PacketFrame]:
    decoder = family.decoder(parts[0], DecoderOptions())
    frames = [frame for part in parts for frame in decoder.add(part)]
    places = decoder.places(parts[0])
    assert (places.dtype, places.shape) == (np.dtype(np.int64), (len(parts[0]),)), "places must be int64, shape (P,)"
    assert places.max(initial=-1) < decoder.places_end, "a place is not below places_end"
    return [*frames, *decoder.finish()]


def _bytes_of(frames: Iterable[PacketFrame]) -> list[tuple[int, bytes]]:
    return [(frame.stamp_ns, frame.points.tobytes()) for frame in frames]


def check_labels(path: Path, frames: Sequence[Frame]) -> None:
    """Check labels of frames: that they are found, the same when asked again, and all used."""
    labels = open_labels(path)
    found = [labels.truth(frame) for frame in frames]
    assert any(found), "no frame is labelled"
    for frame, truth in zip(frames, found, strict=True):
        again = labels.truth(frame)
        assert (truth is None) == (again is None), "asked again, labels are different"
        if truth and again:
            assert _tracks(truth) == _tracks(again), "asked again, labels are different"
            assert truth.points is None or truth.points.shape == (frame.size,), "labels of points need shape (N,)"
    labels.finish()


def _tracks(truth: Truth) -> tuple[str, ...] | None:
    return truth.targets.tracks if truth.targets else None


def check_output(log: Path, name: str, output: Path, read: Callable[[Path], NDArray[np.floating]]) -> None:
    """Check a format of outputs: that a log written to it, twice, has the same bytes and the points of the log.

    ``read`` returns the points of a file or folder, shape (N, 3), of all frames in order; no point may be farther from
    its place than a millimetre.
    """
    files = []
    for target in (output.with_name(f"first_{output.name}"), output.with_name(f"second_{output.name}")):
        convert_log(log, target, to=name)
        inside = sorted(target.rglob("*")) if target.is_dir() else [target]
        files.append([(one.relative_to(target).as_posix(), one.read_bytes()) for one in inside if one.is_file()])
    assert files[0] == files[1], "written again, the bytes are different"
    with open_log(log) as opened:
        wanted = np.concatenate([frame.xyz for frame in opened.frames()])
    found = read(target)
    assert found.shape == wanted.shape, f"points have shape {found.shape}, not {wanted.shape}"
    assert np.allclose(found, wanted, rtol=0, atol=1e-3, equal_nan=True), "points are elsewhere"
