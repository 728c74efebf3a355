"""The interface of writers of logs."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from seaclutter_cli.records import Attachment, Buffer, Channel, Metadata


class LogWriter(Protocol):
    """Writer for the records of a log."""

    @property
    def encoding(self) -> str | None:
        """Encoding of all messages in the log; None if it takes messages of any encoding."""
        ...

    @property
    def messages(self) -> int:
        """Number of messages written."""
        ...

    @property
    def lost(self) -> Sequence[str]:
        """What the log cannot keep of the records so far, in words."""
        ...

    @property
    def broken(self) -> Mapping[str, int]:
        """Number of messages by topic that could not be translated to the encoding."""
        ...

    def add_channel(self, channel: Channel) -> None:
        """Declare a channel under its own id, before its first message."""
        ...

    def write(self, channel: int, log_time_ns: int, publish_time_ns: int, sequence: int, data: Buffer) -> None:
        """Write a message of a declared channel."""
        ...

    def attach(self, attachment: Attachment) -> None:
        """Write an attachment."""
        ...

    def add_metadata(self, metadata: Metadata) -> None:
        """Write a metadata record."""
        ...

    def finish(self) -> None:
        """Complete the log."""
        ...

    def abort(self) -> None:
        """Free resources and leave the log incomplete."""
        ...


class Storage(Protocol):
    """Writer for messages that are already in the encoding of a log, which has no other records."""

    def add_channel(self, channel: Channel) -> None:
        """Declare a channel under its own id, before its first message."""
        ...

    def write(self, channel: int, log_time_ns: int, data: Buffer) -> None:
        """Write a message of a declared channel."""
        ...

    def finish(self, metadata: Sequence[Metadata]) -> None:
        """Complete the log, with metadata records in the form that the format has for such things."""
        ...

    def abort(self) -> None:
        """Free resources and leave the log incomplete."""
        ...
