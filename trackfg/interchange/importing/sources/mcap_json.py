"""MCAP files with messages in JSON, as tools around Foxglove and data loggers write them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from trackfg.files.libraries import library
from trackfg.interchange.importing.shapes.usual_shape import in_usual_shape_of_types
from trackfg.interchange.importing.source_format import DialectFor, SourceFormat, readable, refuse_empty, starts_with
from trackfg.interchange.importing.source_table import SourceTable
from trackfg.interchange.importing.sources.messages import MessageTables, cells_of, measured_ns

MCAP = b"\x89MCAP"
"""What MCAP files begin with."""


class McapJson(SourceFormat):
    """Each topic is a table, on the times that its messages state or else on those of the log."""

    key = "mcap"
    title = "MCAP with messages in JSON"

    def recognises(self, path: Path) -> bool:
        """Return whether it is an MCAP file with a topic in JSON."""
        if not starts_with(path, MCAP):
            return False
        try:
            with path.open("rb") as stream:
                summary = library("mcap.reader", "mcap").make_reader(stream).get_summary()
                return any(channel.message_encoding == "json" for channel in summary.channels.values())
        except Exception:  # a damaged file is of no format; a missing library is named when it is read
            return False

    def tables(self, path: Path, dialect_for: DialectFor) -> Sequence[SourceTable]:
        """Read the topics in JSON."""
        reader = library("mcap.reader", "mcap")
        topics = MessageTables()
        with readable(path, "an MCAP file"), path.open("rb") as stream:
            for _, channel, message in reader.make_reader(stream).iter_messages():
                if channel.message_encoding == "json":
                    content = json.loads(message.data)
                    topics.take(channel.topic, measured_ns(content, message.log_time), cells_of(content))
        return refuse_empty(in_usual_shape_of_types(list(topics.tables())), path, "messages in JSON with numbers")
