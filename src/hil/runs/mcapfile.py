"""MCAP files as hil writes them: JSON messages with schemas, in chunks that end twice a second.

A chunk that has ended is on its way to the disk, so a killed process loses only the chunk it was
filling. Such a file has no footer and perhaps half a chunk at its end: `McapSource` reads it as far
as it is whole, skips what does not match its checksum, and says so in `damage`.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

from mcap.exceptions import InvalidMagic, McapError
from mcap.records import Attachment, Channel, Chunk, Header, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer
from zstandard import ZstdError

from hil.errors import RunError

_BROKEN: Final = (McapError, ZstdError, struct.error, ValueError, MemoryError)
"""What mcap raises on bytes that are cut short or wrong (ValueError: checksum, text)."""

_PREFIX: Final = "hil."
"""Before the names of our schemas in a file, so that they meet nobody else's."""


class McapMessage(NamedTuple):
    """One message: its topic, its time (ns since 1970) and its JSON."""

    topic: str
    log_time_ns: int
    data: bytes


class McapSink:
    """Writes messages by topic; a topic's channel and schema are made when it is first used.

    Messages of another `encoding` than JSON have no schema: theirs is called "".
    """

    def __init__(
        self, stream: IO[bytes], schemas: Mapping[str, dict[str, Any]], encoding: str = "json"
    ) -> None:
        self._schemas = schemas
        self._encoding = encoding
        self._schema_ids: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._writer = Writer(stream, chunk_size=1 << 20)
        self._writer.start(profile="", library="hil")

    def attach(self, name: str, media_type: str, data: bytes, time_ns: int) -> None:
        """Put a file into the file: the rig file and the run's metadata travel with the data."""
        self._writer.add_attachment(time_ns, time_ns, name, media_type, data)

    def write(self, topic: str, schema: str, data: bytes, log_time_ns: int) -> None:
        """Add one message; `schema` names one of the schemas given at the start."""
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._open(topic, schema)
        self._writer.add_message(channel, log_time_ns, data, log_time_ns)

    def flush(self) -> None:
        """End the chunk and hand all of it to the operating system."""
        self._writer.flush()

    def finish(self) -> None:
        """Write index and footer; nothing can be added after."""
        self._writer.finish()

    def _open(self, topic: str, schema: str) -> int:
        if not schema:
            return int(self._writer.register_channel(topic, self._encoding, 0))
        if schema not in self._schema_ids:
            text = json.dumps(self._schemas[schema]).encode()
            self._schema_ids[schema] = self._writer.register_schema(
                f"{_PREFIX}{schema}", "jsonschema", text
            )
        return int(self._writer.register_channel(topic, self._encoding, self._schema_ids[schema]))


class McapRecords:
    """Iterates over a file's records of every kind and encoding, chunks opened, as far as it is whole.

    After the iteration `damage` is a sentence where the file is cut short or parts of it are wrong.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damage: str | None = None

    def __iter__(self) -> Iterator[object]:
        bad_chunks = 0
        cut = False
        with self.path.open("rb") as stream:
            try:
                for record in StreamReader(stream, emit_chunks=True).records:
                    if not isinstance(record, Chunk):
                        yield record
                        continue
                    try:
                        inside = breakup_chunk(record, validate_crc=True)
                    except _BROKEN:
                        bad_chunks += 1
                        continue
                    yield from inside
            except InvalidMagic as error:
                if stream.tell() <= 8:
                    raise RunError(f"{self.path}: is no MCAP file") from error
                cut = True
            except _BROKEN:
                cut = True
        notes = [f"{bad_chunks} chunks do not match their checksum"] if bad_chunks else []
        if cut:
            notes.append("it has no end: the recorder was killed or the file was cut")
        if notes:
            self.damage = f"{self.path}: " + "; ".join(notes)


class McapSource:
    """Iterates over a file's messages of one `encoding` in the order in which they were written.

    After the iteration `attachments` holds the files inside by name, and `damage` what McapRecords says.
    """

    def __init__(self, path: Path, encoding: str = "json") -> None:
        self.path = path
        self._encoding = encoding
        self.attachments: dict[str, bytes] = {}
        self.damage: str | None = None
        self._topics: dict[int, str] = {}

    def __iter__(self) -> Iterator[McapMessage]:
        records = McapRecords(self.path)
        for record in records:
            if isinstance(record, Message):
                topic = self._topics.get(record.channel_id)
                if topic is not None:
                    yield McapMessage(topic, record.log_time, record.data)
            elif isinstance(record, Channel) and record.message_encoding == self._encoding:
                self._topics[record.id] = record.topic
            elif isinstance(record, Attachment):
                self.attachments[record.name] = record.data
        self.damage = records.damage


def copy_records(path: Path, stream: IO[bytes]) -> None:
    """Write all that can be read of the file at `path` into a whole one: messages of every encoding."""
    profile = next((r.profile for r in McapRecords(path) if isinstance(r, Header)), "")
    writer = Writer(stream, chunk_size=1 << 20)
    writer.start(profile, library="hil")
    schemas, channels = {0: 0}, dict[int, int]()
    for record in McapRecords(path):
        if isinstance(record, Message) and record.channel_id in channels:
            to = channels[record.channel_id]
            writer.add_message(
                to, record.log_time, record.data, record.publish_time, record.sequence
            )
        elif isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in channels:
            schema = schemas.get(record.schema_id, 0)
            channels[record.id] = writer.register_channel(
                record.topic, record.message_encoding, schema, record.metadata
            )
        elif isinstance(record, Attachment):
            writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            )
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
    writer.finish()
