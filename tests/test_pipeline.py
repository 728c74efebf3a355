"""Records that wait for filters which look ahead: their order, their number, and the results of their frames."""

from collections import Counter
from contextlib import closing
from dataclasses import astuple, replace

import numpy as np
import pytest

import seaclutter
from seaclutter_cli import pipeline
from seaclutter_cli.cloud import from_array
from seaclutter_cli.errors import FieldError, MethodError
from seaclutter_cli.filters import FILTERS
from seaclutter_cli.frame import FilterResult, Frame
from seaclutter_cli.pipeline import RecordHolder, run, run_each
from seaclutter_cli.reading import frames, read
from seaclutter_cli.records import Attachment, Channel, Message, Metadata
from seaclutter_cli.selection import Selection, cloud_channels
from seaclutter_cli.sources.formats import open_source
from seaclutter_cli.sources.recordings import find_recordings
from tests.filters.seas import Body, sea_log
from tests.logs import START_NS, Entry, Topic, cloud_message, cloud_topic, write_log
from tests.paths import ROOT
from tests.running import execute
from tests.sinks.runs import contents
from tests.test_formats import FORMATS

SEA, LABELS = ROOT / "samples" / "sea.mcap", ROOT / "samples" / "sea.labels.csv"
CLOUDS = {name: Channel(number, name, "cdr", None) for number, name in enumerate(("/bow", "/aft"))}
NOTE = Channel(9, "/note", "json", None)
MS = 1_000_000


class Ahead:
    """Filter whose results are complete when the log has gone on for long enough; frames of odd size have no field."""

    def __init__(self, look_ahead_s=0.5):
        self.look_ahead_s = look_ahead_s
        self.waiting = []
        self.flushed = []

    def process(self, frame):
        if frame.size % 2:
            raise FieldError("no field 'odd'")
        self.waiting.append(frame)
        known = [one for one in self.waiting if one.stamp_ns <= frame.stamp_ns - 1e9 * self.look_ahead_s]
        return [self.result(one) for one in known]

    def flush(self):
        self.flushed.append([frame.index for frame in self.waiting])
        return [self.result(frame) for frame in list(self.waiting)]

    def result(self, frame):
        self.waiting.remove(frame)
        return FilterResult(frame, np.zeros(frame.size, np.uint8))


def cloud(topic, time_ms, index, *, size=2):
    """Return the record and the frame of a cloud."""
    message = Message(CLOUDS[topic], time_ms * MS, time_ms * MS, index, bytes(4 * size))
    return message, Frame.of_message(message, from_array(np.zeros(size, [("x", "f4")])), index)


def note(time_ms):
    return Message(NOTE, time_ms * MS, time_ms * MS, 0, b"{}"), None


class Held:
    """Records passed through a holder, with how long and how many bytes it held."""

    def __init__(self, holder, records):
        self.out, self.longest_ns, self.most_bytes = [], 0, 0
        times = []
        for record, frame in records:
            times += [record.log_time_ns] if isinstance(record, Message) else times[-1:]
            self.out += holder.add(record, frame)
            if len(self.out) < len(times):
                self.longest_ns = max(self.longest_ns, times[-1] - times[len(self.out)])
            self.most_bytes = max(self.most_bytes, sum(one.nbytes for one in holder._held))
        self.before_the_end = len(self.out)
        self.out += holder.finish()
        assert [id(one.record) for one in self.out] == [id(record) for record, _ in records], "order of the log"
        for one in self.out:
            if one.frame is not None:
                own = [result for result in one.results if isinstance(result, FilterResult)]
                assert None not in one.results, "complete"
                assert all(result.frame is one.frame for result in own)


def two_topics(bow=range(0, 4000, 100), aft=range(30, 4000, 100), notes=range(0, 4000, 20), size=2):
    """Return records of two cloud topics and one other, in the order of their times."""
    records = [(at, cloud("/bow", at, k, size=size)) for k, at in enumerate(bow)]
    records += [(at, cloud("/aft", at, k, size=size)) for k, at in enumerate(aft)]
    records += [(at, note(at)) for at in notes]
    return [pair for _, pair in sorted(records, key=lambda one: one[0])]


class TestHolder:
    def test_the_order_is_that_of_the_log(self):
        extras = [(Attachment(0, 0, "a", "", b"123"), None), (Metadata("m", {}), None)]
        records = two_topics()
        records[50:50] = extras
        held = Held(RecordHolder({"/bow": [Ahead()], "/aft": [Ahead(0.2)]}), records)
        assert 400 * MS <= held.longest_ns <= 600 * MS

    def test_without_look_ahead_nothing_waits(self):
        held = Held(RecordHolder({"/bow": [Ahead(0.0)], "/aft": [Ahead(0.0)]}), two_topics())
        assert held.longest_ns == 0
        assert held.before_the_end == len(held.out)

    @pytest.mark.parametrize("early", ["/bow", "/aft"])
    def test_a_topic_that_ends_early_holds_no_more_than_a_second(self, early):
        name = early.strip("/")
        methods = {"/bow": [Ahead()], "/aft": [Ahead()]}
        held = Held(RecordHolder(methods), two_topics(**{name: range(0, 300, 100)}, notes=range(0, 20_000, 20)))
        assert held.longest_ns <= 1020 * MS
        assert methods[early][0].flushed[0] == [0, 1, 2]

    def test_gaps_in_time(self):
        gaps = [*range(0, 1000, 100), *range(1800, 2500, 100), *range(9000, 9500, 100)]
        held = Held(
            RecordHolder({"/bow": [Ahead()], "/aft": [Ahead()]}), two_topics(bow=gaps, notes=range(0, 9500, 20))
        )
        assert held.longest_ns <= 1020 * MS

    def test_a_pause_of_the_whole_log(self):
        """The first record behind the pause shows that the frames of both topics are late."""
        records = two_topics(range(0, 500, 100), range(0, 500, 100), range(0, 500, 100))
        held = Held(RecordHolder({"/bow": [Ahead()], "/aft": [Ahead()]}), [*records, note(60_000)])
        assert held.before_the_end == len(held.out)

    def test_memory_is_bounded(self, monkeypatch):
        monkeypatch.setattr(pipeline, "_MAX_HELD_BYTES", 10_000)
        method = Ahead(5.0)
        held = Held(RecordHolder({"/bow": [method], "/aft": [Ahead(0.0)]}), two_topics(aft=[], size=500))
        assert 8_000 <= held.most_bytes <= 12_000
        assert len(method.flushed) >= 5

    def test_a_single_message_beyond_the_limit(self, monkeypatch):
        monkeypatch.setattr(pipeline, "_MAX_HELD_BYTES", 100)
        held = Held(RecordHolder({"/bow": [Ahead()], "/aft": [Ahead()]}), two_topics(size=500))
        assert held.most_bytes <= 100

    def test_frames_with_errors_keep_their_places(self):
        records = two_topics()
        for at in (0, 51, 52, 53, len(records) - 1):
            if records[at][1] is not None:
                record, frame = records[at]
                records[at] = cloud(record.channel.topic, record.log_time_ns // MS, frame.index, size=3)
        held = Held(RecordHolder({"/bow": [Ahead(), Ahead(0.0)], "/aft": [Ahead()]}), records)
        failed = [one for one in held.out if one.frame is not None and one.frame.size == 3]
        assert len(failed) >= 2
        for one in failed:
            assert all(isinstance(result, FieldError) for result in one.results)

    def test_a_method_that_never_decides(self):
        method = Ahead()
        method.flush = list
        with pytest.raises(MethodError, match="one result for each frame"):
            Held(RecordHolder({"/bow": [method]}), two_topics(range(0, 300, 100), aft=[]))

    def test_several_methods_with_and_without_look_ahead(self):
        methods = [Ahead(0.0), Ahead(0.3), Ahead(0.7)]
        held = Held(RecordHolder({"/bow": methods}), two_topics(aft=[]))
        assert 600 * MS <= held.longest_ns <= 800 * MS

    def test_only_late_frames_are_decided_early(self):
        """Otherwise other topics of the log change the results of this one, if it looks ahead for more than 0.5 s."""
        method = Ahead(2.0)
        pause = [*range(0, 2000, 100), *range(2700, 5000, 100)]
        Held(RecordHolder({"/bow": [method]}), two_topics(bow=pause, aft=[], notes=range(0, 5000, 20)))
        assert len(method.flushed) == 1, "at the end"


class Recorder:
    """Sink that stores what it receives, as it was then."""

    def __init__(self):
        self.records, self.results = [], []

    def begin(self, source, clouds):
        pass

    def copy(self, record):
        self.records.append(plain(record))

    def write(self, result):
        self.records.append(plain(result.frame.message))
        self.results.append((result.frame.topic, result.frame.index, result.reason.tolist()))

    def end(self):
        pass


def plain(record):
    return astuple(replace(record, data=bytes(record.data))) if hasattr(record, "data") else astuple(record)


def confirmed(**params):
    return FILTERS["confirmed"](FILTERS["confirmed"].Params(**params))


def filtered(log, *, topics=(), make=confirmed, **selection):
    """Return what a sink receives of a log."""
    sink = Recorder()
    (recording,) = find_recordings([str(log)])
    with closing(recording.open()) as source:
        list(run(source, make, [sink], Selection(topics=topics, **selection), {}))
        assert not source.damage
    return sink


def results_of(log, topic, make=confirmed, **selection):
    """Return the results of one topic, with a filter alone."""
    (recording,) = find_recordings([str(log)])
    with closing(recording.open()) as source:
        method = make()
        found = [
            (result.frame.topic, result.frame.index, result.reason.tolist())
            for frame in frames(source, Selection(topics=[topic], **selection))
            for result in method.process(frame)
        ]
        return found + [(one.frame.topic, one.frame.index, one.reason.tolist()) for one in method.flush()]


def sea_entries(topic, seed, times_s):
    """Return messages of a small sea at given times."""
    log = sea_log(seed, [Body(20, 5), Body(-15, 20, height=0.3)], times_s, size=150)
    stamps = [START_NS + round(1e9 * time_s) for time_s in times_s]
    return [
        Entry(topic, stamp, cloud_message("ros2", frame.cloud.points, stamp), sequence=number)
        for number, (stamp, frame) in enumerate(zip(stamps, log, strict=True))
    ]


def sea_file(path, *, aft_frames=25):
    """Write a log of two lidars, one of which may end early, and an IMU."""
    entries = sea_entries("/bow", 1, 0.1 * np.arange(25)) + sea_entries("/aft", 2, 0.03 + 0.1 * np.arange(aft_frames))
    entries += [Entry("/imu", START_NS + 10 * MS * number, b"\0" * 12) for number in range(250)]
    topics = [cloud_topic("/bow"), cloud_topic("/aft"), Topic("/imu")]
    return write_log(path, topics, sorted(entries, key=lambda entry: entry.log_time_ns))


class TestLogs:
    @pytest.mark.parametrize("aft_frames", [25, 4])
    def test_two_lidars_and_an_imu(self, tmp_path, aft_frames):
        log = sea_file(tmp_path / "log.mcap", aft_frames=aft_frames)
        sink = filtered(log, topics=("/bow", "/aft"))
        with closing(open_source(log)) as source:
            assert sink.records == [plain(record) for record in source.records()]
        for topic in ("/bow", "/aft"):
            assert [one for one in sink.results if one[0] == topic] == results_of(log, topic)

    @pytest.mark.parametrize("name", [*FORMATS, "capture"])
    def test_what_waits_does_not_change(self, tmp_path, name):
        """Messages may be views of buffers that a source reads into."""
        log = ROOT / "samples" / "rs-lidar-32.pcap" if name == "capture" else FORMATS[name](tmp_path)
        sink = filtered(log)
        (recording,) = find_recordings([str(log)])
        with closing(recording.open()) as source:
            pairs = read(source, cloud_channels(source), Selection())
            assert sink.records == [plain(frame.message if frame else record) for record, frame in pairs]
        (topic,) = {topic for topic, _, _ in sink.results}
        assert sink.results == results_of(log, topic)

    @pytest.mark.parametrize(("start_s", "end_s"), [(0.5, 1.7), (None, 0.35), (2.0, None), (0.95, 1.0)])
    def test_a_clip_has_the_results_of_a_log_of_its_own(self, tmp_path, start_s, end_s):
        log = sea_file(tmp_path / "log.mcap")
        clip = {"start_s": start_s, "end_s": end_s}
        sink = filtered(log, topics=("/bow", "/aft"), **clip)
        low, high = (-1 if start_s is None else start_s), (9 if end_s is None else end_s)
        with closing(open_source(log)) as source:
            whole = [plain(record) for record in source.records()]
        assert sink.records == [one for one in whole if low <= (one[1] - START_NS) / 1e9 < high]
        for topic in ("/bow", "/aft"):
            assert [one for one in sink.results if one[0] == topic] == results_of(log, topic, **clip)

    def test_a_number_of_frames(self, tmp_path):
        sink = filtered(sea_file(tmp_path / "log.mcap"), topics=("/bow", "/aft"), frames=7)
        assert Counter(topic for topic, _, _ in sink.results) == {"/bow": 7, "/aft": 7}

    def test_frames_without_a_field_in_the_middle_are_damage(self, tmp_path):
        entries = sea_entries("/points", 1, 0.1 * np.arange(20))
        for number in (9, 10):
            points = np.zeros(50, [("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
            entries[number] = entries[number]._replace(data=cloud_message("ros2", points, entries[number].log_time_ns))
        log = write_log(tmp_path / "log.mcap", [cloud_topic("/points")], entries)
        sink = Recorder()
        with closing(open_source(log)) as source:
            list(run(source, confirmed, [sink], Selection(), {}))
            assert ["no intensity field" in str(one) for one in source.damage] == [True, True]
        assert [index for _, index, _ in sink.results] == [*range(9), *range(11, 20)]

    def test_a_log_in_two_files_gives_the_same_bytes_as_one(self, tmp_path):
        entries, topics = sea_entries("/points", 1, 0.1 * np.arange(16)), [cloud_topic("/points")]
        for name, parts in (("one", [entries]), ("two", [entries[:9], entries[9:]])):
            folder = tmp_path / name / "sea"
            folder.mkdir(parents=True)
            for number, part in enumerate(parts):
                write_log(folder / f"sea_{number}.mcap", topics, part)
            out = tmp_path / name / "out.mcap"
            arguments = ["filter", folder, "-m", "confirmed", "-o", out, "--with-removed"]
            execute(*arguments, code=0)
        one, two = ((tmp_path / name / "out.mcap").read_bytes() for name in ("one", "two"))
        end = one.index(b"seaclutter.run")  # this record is about the files
        assert one[:end] == two[:end]
        found = contents(tmp_path / "two" / "out.mcap")
        assert [message.sequence for message in found.topics["/points"]] == list(range(16))


class TestSideBySide:
    NAMES = ("confirmed", "joint", "none", "confirmed")

    def test_each_method_has_the_results_of_a_run_of_its_own(self):
        makers = [lambda own=FILTERS[name]: own(own.Params()) for name in self.NAMES]
        makers[3] = lambda: confirmed(look_ahead_s=0.2)
        found = [[] for _ in makers]

        with closing(open_source(SEA)) as source:
            for frame, results, seconds in run_each(source, [make() for make in makers], Selection(frames=25)):
                for own, result in zip(found, results, strict=True):
                    assert result.frame is frame
                    own.append((frame.topic, frame.index, result.reason.tolist()))
                assert len(seconds) == len(makers)
        for make, own in zip(makers, found, strict=True):
            assert own == results_of(SEA, "/points", make, frames=25)

    def test_scores_are_those_of_separate_runs(self):
        together = seaclutter.evaluate(SEA, LABELS, methods=["joint", "confirmed"], frames=25).totals()
        for name in ("joint", "confirmed"):
            alone = seaclutter.evaluate(SEA, LABELS, methods=name, frames=25).totals()
            assert without_times(alone[name]) == without_times(together[name])


def without_times(summary):
    return {name: value for name, value in vars(summary).items() if name != "durations"}
