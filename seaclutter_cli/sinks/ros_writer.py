"""Writers of logs in which all messages have the encoding of one version of ROS."""

from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

from seaclutter_cli.messages.layouts import TranslationError
from seaclutter_cli.messages.translation import translator
from seaclutter_cli.records import Attachment, Buffer, Channel, Metadata
from seaclutter_cli.sinks.log_output import LogWriter
from seaclutter_cli.text import count


class PassingWriter(LogWriter):
    """Writer that passes records on to another one."""

    def __init__(self, writer: LogWriter) -> None:
        self.writer = writer

    @property
    def lost(self) -> Sequence[str]:
        """What the log cannot keep, in words."""
        return self.writer.lost

    def add_channel(self, channel: Channel) -> None:
        """Declare a channel."""
        self.writer.add_channel(channel)

    def write(self, channel: int, log_time_ns: int, publish_time_ns: int, sequence: int, data: Buffer) -> None:
        """Write a message."""
        self.writer.write(channel, log_time_ns, publish_time_ns, sequence, data)
        self.messages += 1

    def attach(self, attachment: Attachment) -> None:
        """Write an attachment."""
        self.writer.attach(attachment)

    def add_metadata(self, metadata: Metadata) -> None:
        """Write a metadata record."""
        self.writer.add_metadata(metadata)

    def finish(self) -> None:
        """Complete the log."""
        self.writer.finish()

    def abort(self) -> None:
        """Leave the log incomplete."""
        self.writer.abort()


class TranslatingWriter(PassingWriter):
    """Writer that translates messages to ``ros1`` or ``cdr``; channels that cannot be translated are left out."""

    def __init__(self, writer: LogWriter, encoding: str) -> None:
        super().__init__(writer)
        self.encoding = self._encoding = encoding
        self.broken = self._broken = Counter[str]()
        self._translate: dict[int, tuple[str, Callable[[Buffer], Buffer]] | None] = {}
        self._left_out: dict[str, str] = {}
        self._fields: dict[str, None] = {}

    @property
    def lost(self) -> Sequence[str]:
        """What the log cannot keep, in words."""
        topics = [f"{topic} ({reason})" for topic, reason in self._left_out.items()]
        return [*super().lost, *self._fields, *topics]

    def add_channel(self, channel: Channel) -> None:
        """Declare a channel, unless its messages cannot be translated."""
        try:
            found = translator(channel, self._encoding)
        except TranslationError as error:
            self._left_out[channel.topic] = str(error)
            self._translate[channel.id] = None
            return
        self._fields |= dict.fromkeys(f"{name} of {channel.topic}" for name in found.lost)
        self._translate[channel.id] = channel.topic, found.translate
        super().add_channel(replace(found.channel, id=channel.id))

    def write(self, channel: int, log_time_ns: int, publish_time_ns: int, sequence: int, data: Buffer) -> None:
        """Write a message; leave it out if it is not valid."""
        found = self._translate[channel]
        if found is None:
            return
        topic, translate = found
        try:
            translated = translate(data)
        except TranslationError:
            self._broken[topic] += 1
            return
        super().write(channel, log_time_ns, publish_time_ns, sequence, translated)


class MessagesOnly(LogWriter):
    """Writer of a log whose messages have one time each, and which has neither attachments nor metadata records.

    Metadata records are kept in ``metadata`` for the end, in the form that the format has for such things.
    """

    def __init__(self) -> None:
        self.metadata: list[Metadata] = []
        self._attachments = 0
        self._has_publish_times = self._has_sequences = False

    @property
    def lost(self) -> Sequence[str]:
        """What the log cannot keep, in words."""
        found = {
            count(self._attachments, "attachment"): self._attachments,
            "publish times": self._has_publish_times,
            "sequence numbers": self._has_sequences,
        }
        return [name for name, is_lost in found.items() if is_lost]

    @abstractmethod
    def put(self, channel: int, log_time_ns: int, data: Buffer) -> None:
        """Write a message of a declared channel."""

    def write(self, channel: int, log_time_ns: int, publish_time_ns: int, sequence: int, data: Buffer) -> None:
        """Write a message."""
        self._has_publish_times |= publish_time_ns != log_time_ns
        self._has_sequences |= sequence != 0
        self.put(channel, log_time_ns, data)
        self.messages += 1

    def attach(self, attachment: Attachment) -> None:  # noqa: ARG002
        """Count an attachment, which is lost."""
        self._attachments += 1

    def add_metadata(self, metadata: Metadata) -> None:
        """Keep a metadata record for the end."""
        self.metadata.append(metadata)
