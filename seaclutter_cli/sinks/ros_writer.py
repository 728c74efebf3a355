"""Writers of logs in which all messages have the encoding of one version of ROS."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

from seaclutter_cli.messages.layouts import TranslationError
from seaclutter_cli.messages.translation import translator
from seaclutter_cli.records import Attachment, Buffer, Channel, Metadata
from seaclutter_cli.sinks.log_writer import LogWriter, Storage
from seaclutter_cli.text import count


class TranslatingWriter:
    """Writer that translates messages to one encoding.

    Channels whose messages cannot be translated are left out.

    Parameters
    ----------
    writer : LogWriter
        Receives what is translated.
    encoding : str
        ``ros1`` or ``cdr``.
    """

    def __init__(self, writer: LogWriter, encoding: str) -> None:
        self.encoding: str | None = encoding
        self.broken = Counter[str]()
        self._writer, self._encoding = writer, encoding
        self._translate: dict[int, tuple[str, Callable[[Buffer], Buffer]] | None] = {}
        self._left_out: dict[str, str] = {}
        self._fields: dict[str, None] = {}

    @property
    def lost(self) -> Sequence[str]:
        """What the log cannot keep, in words."""
        topics = [f"{topic} ({reason})" for topic, reason in self._left_out.items()]
        return [*self._writer.lost, *self._fields, *topics]

    @property
    def messages(self) -> int:
        """Number of messages written."""
        return self._writer.messages

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
        self._writer.add_channel(replace(found.channel, id=channel.id))

    def write(self, channel: int, log_time_ns: int, publish_time_ns: int, sequence: int, data: Buffer) -> None:
        """Write a message; leave it out if it is not valid."""
        found = self._translate[channel]
        if found is None:
            return
        topic, translate = found
        try:
            translated = translate(data)
        except TranslationError:
            self.broken[topic] += 1
            return
        self._writer.write(channel, log_time_ns, publish_time_ns, sequence, translated)

    def attach(self, attachment: Attachment) -> None:
        """Write an attachment."""
        self._writer.attach(attachment)

    def add_metadata(self, metadata: Metadata) -> None:
        """Write a metadata record."""
        self._writer.add_metadata(metadata)

    def finish(self) -> None:
        """Complete the log."""
        self._writer.finish()

    def abort(self) -> None:
        """Leave the log incomplete."""
        self._writer.abort()


class MessagesOnly:
    """Writer to a storage that has messages with one time each, and neither attachments nor metadata records.

    Parameters
    ----------
    storage : Storage
        Receives the messages and, at the end, the metadata records.
    """

    encoding: str | None = None

    def __init__(self, storage: Storage) -> None:
        self.broken = Counter[str]()
        self._storage = storage
        self._metadata: list[Metadata] = []
        self.messages = 0
        self._attachments = 0
        self._has_publish_times = self._has_sequences = False

    @property
    def lost(self) -> Sequence[str]:
        """What the storage cannot keep, in words."""
        found = {
            count(self._attachments, "attachment"): self._attachments,
            "publish times": self._has_publish_times,
            "sequence numbers": self._has_sequences,
        }
        return [name for name, is_lost in found.items() if is_lost]

    def add_channel(self, channel: Channel) -> None:
        """Declare a channel."""
        self._storage.add_channel(channel)

    def write(self, channel: int, log_time_ns: int, publish_time_ns: int, sequence: int, data: Buffer) -> None:
        """Write a message."""
        self._has_publish_times |= publish_time_ns != log_time_ns
        self._has_sequences |= sequence != 0
        self._storage.write(channel, log_time_ns, data)
        self.messages += 1

    def attach(self, attachment: Attachment) -> None:  # noqa: ARG002
        """Count an attachment, which is lost."""
        self._attachments += 1

    def add_metadata(self, metadata: Metadata) -> None:
        """Keep a metadata record for the end."""
        self._metadata.append(metadata)

    def finish(self) -> None:
        """Complete the log."""
        self._storage.finish(self._metadata)

    def abort(self) -> None:
        """Leave the log incomplete."""
        self._storage.abort()
