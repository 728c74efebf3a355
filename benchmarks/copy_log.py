"""Copy a log with the ``mcap`` library, without decoding, same compression; the reference of filter runs."""

import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer


def main(source: str, target: str) -> None:
    with Path(source).open("rb") as stream, Path(target).open("wb") as out:
        reader = make_reader(stream)
        writer = Writer(out, compression=CompressionType.ZSTD)
        writer.start(profile="ros2")
        schemas, channels = {}, {}
        for schema, channel, message in reader.iter_messages():
            if channel.id not in channels:
                if schema.id not in schemas:
                    schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence
            )
        writer.finish()


if __name__ == "__main__":
    main(*sys.argv[1:])
