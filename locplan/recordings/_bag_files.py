"""Bags of ROS 1 and ROS 2: opened, their topics by type, their messages decoded, and copied.

What rosbags unpacks is bounded: a packed megabyte may hold gigabytes.
"""

from __future__ import annotations

import os
import sqlite3
import warnings
from bz2 import BZ2Decompressor
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import closing, contextmanager
from enum import StrEnum
from functools import cache, partial
from io import BufferedReader
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

from locplan._util import reading
from locplan._util.files import errors_in_one_line, keep_input
from locplan._util.progress import ProgressCallback
from locplan._util.public import needed
from locplan.errors import LocplanError, RecordingError

MAX_CHUNK_BYTES = 2**26
"""Maximum size of a chunk, or of a message that is packed by itself, once it is unpacked."""
MAX_RATIO = 100
"""Maximum size of a file that is packed as a whole, once it is unpacked, to its own."""
MENDERS = {".mcap": "mcap recover", ".db3": "sqlite3 FILE .recover", ".bag": "rosbag reindex"}
"""The program that mends a damaged bag, by the suffix of the file."""
SUFFIXES: tuple[str, ...] = (*MENDERS,)


class Kind(StrEnum):
    """Types of messages."""

    SCAN = "sensor_msgs/msg/LaserScan"
    TF = "tf2_msgs/msg/TFMessage"
    POSE_WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
    POSE = "geometry_msgs/msg/PoseStamped"
    ODOMETRY = "nav_msgs/msg/Odometry"


class Message(NamedTuple):
    """A message: its topic, time of the log [ns], and content."""

    topic: str
    logged: int
    content: Any


class Bag:
    """A bag that is open for reading; made by `opened`."""

    def __init__(self, reader: Any, typestore: Any, ros1: bool) -> None:
        self._reader, self._typestore, self._ros1 = reader, typestore, ros1

    @property
    def start(self) -> int:
        """Time of the log of the first message [ns]."""
        return int(self._reader.start_time)

    def of_type(self, *types: str) -> list[str]:
        """Names of the topics of these types that have messages."""
        some = (each for each in self._reader.connections if _type(each) in types)
        return list(dict.fromkeys(each.topic for each in some))

    def count(self, topics: Collection[str]) -> int:
        """Number of the messages of some topics."""
        return sum(each.msgcount for each in self._reader.connections if each.topic in topics)

    def messages(
        self,
        topics: Collection[str],
        start: int | None = None,
        stop: int | None = None,
        every: int = 1,
        progress: ProgressCallback | None = None,
    ) -> Iterator[Message]:
        """Every n-th message of some topics, in the order of the log, within times of it [ns].

        Only these are decoded, one at a time.
        """
        chosen = [each for each in self._reader.connections if each.topic in topics]
        if not chosen:
            return
        total = self.count(topics)
        stream = self._reader.messages(connections=chosen, start=start, stop=stop)
        for number, (connection, logged, raw) in enumerate(stream):
            if progress and number % 1000 == 0:
                progress(min(number, total), total)
            if number % every == 0:
                yield self._decoded(connection, logged, raw)
        if progress:
            progress(total, total)

    def _decoded(self, connection: Any, logged: int, raw: bytes) -> Message:
        """A message that was read."""
        store = self._typestore
        decode = store.deserialize_ros1 if self._ros1 else store.deserialize_cdr
        return Message(connection.topic, logged, decode(raw, _type(connection)))

    def listed(self) -> str:
        """The topics and their types, for an error message."""
        every = self._reader.connections
        names = {f"{each.topic} ({_type(each).replace('/msg/', '/')})" for each in every}
        return ", ".join(sorted(names)) or "none"

    @property
    def types(self) -> Mapping[str, Any]:
        """The classes of messages by the names of their types."""
        types: Mapping[str, Any] = self._typestore.types
        return types

    def copy(
        self,
        target: Path,
        kind: Kind,
        topics: Collection[str],
        beside: str,
        made: Callable[[Message], tuple[str, Any] | None],
    ) -> None:
        """Write a copy that has topics of ours, in place of those of the same names.

        Parameters
        ----------
        target : path
            The new bag, a file of ROS 1 or a folder of ROS 2, which must not exist.
        kind, topics
            Type and names of our topics.
        beside : str
            Topic after whose messages ours are written.
        made : callable
            Gives one of our topics and what is written there, or None, for a message of `beside`.

        Raises
        ------
        LocplanError
            If the copy cannot be written.
        """
        theirs = [each for each in self._reader.connections if each.topic not in topics]
        store = self._typestore
        encode = store.serialize_ros1 if self._ros1 else store.serialize_cdr
        with _writing(target), self._writer(target) as writer:
            known: dict[int, Any] = {}
            alike: dict[str, Any] = {}  # of bags that were joined
            for each in theirs:
                about = each.topic, each.msgtype, each.ext
                if str(about) not in alike:
                    alike[str(about)] = writer.add_connection(*about[:2], **self._like(each))
                known[each.id] = alike[str(about)]
            own = {each: writer.add_connection(each, str(kind), typestore=store) for each in topics}
            for connection, logged, raw in self._reader.messages(connections=theirs):
                writer.write(known[connection.id], logged, raw)
                if connection.topic == beside:
                    found = made(self._decoded(connection, logged, raw))
                    if found is not None:
                        writer.write(own[found[0]], logged, encode(found[1], str(kind)))

    def _writer(self, target: Path) -> Any:
        """The writer of a bag of the same kind, which packs it as all readers can unpack it."""
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

        if self._ros1:
            writer = Writer1(target)
            writer.set_compression(Writer1.CompressionFormat.LZ4)
            return writer
        path, plugin = self._reader.path, StoragePlugin.SQLITE3
        packed = self._reader.compression_mode or "none"
        if any(".mcap" in each.suffixes for each in (path.iterdir() if path.is_dir() else [path])):
            packed, plugin = "storage", StoragePlugin.MCAP
        # ROS 2 Humble reads version 8, but not the qualities of service of the next one.
        writer2 = Writer(target, version=8, storage_plugin=plugin)
        writer2.set_compression(CompressionMode[packed.upper()], CompressionFormat.ZSTD)
        return writer2

    def _like(self, each: Any) -> dict[str, Any]:
        """What a writer is told of a topic, for it to be as in this bag."""
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        text, digest, about = each.msgdef.data, each.digest, each.ext._asdict()
        if self._ros1:
            return {"msgdef": text, "md5sum": digest, **about}
        if not (text and digest):  # older bags lack one or both
            store = self._typestore
            if each.msgtype in store.types:
                return {"typestore": store, **about}
            store = get_typestore(Stores.EMPTY)
            store.register(get_types_from_msg(text, each.msgtype))
            digest = store.hash_rihs01(each.msgtype)
        return {"msgdef": text, "rihs01": digest, **about}


@contextmanager
def _writing(target: Path) -> Iterator[None]:
    """Have errors of writing named as such, which `opened` takes for those of reading."""
    with errors_in_one_line(target):
        try:
            yield
        except sqlite3.Error as error:  # such as of a full disk
            raise LocplanError(f"{target}: cannot be written ({error})") from None


def _type(connection: Any) -> str:
    """Type of a topic's messages, or the newer one of the same layout."""
    kind = str(connection.msgtype)
    return Kind.TF if kind == "tf/msg/tfMessage" else kind


@contextmanager
def opened(path: Path) -> Iterator[Bag]:
    """Open a bag: a file .mcap, .db3 or .bag, or a folder of rosbag2.

    Whatever goes wrong while it is read becomes a RecordingError of one line.

    Raises
    ------
    LocplanError
        If the library rosbags is missing.
    RecordingError
        If the bag cannot be read.
    """
    needed("rosbags", "ros", "reading a bag")
    from rosbags.rosbag1 import Reader as Reader1, reader as reader1
    from rosbags.rosbag2 import Reader as Reader2, reader as reader2, storage_mcap
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    file = storage_of(path)
    ros1 = file.suffix == ".bag"
    try:
        for each in file.iterdir() if file.is_dir() else (file,):
            if not each.is_dir():
                reading.opened(each).close()  # rosbags would wait for a pipe
                keep_input(each)
        bound_unpacking(reader1, reader2, storage_mcap)
        with warnings.catch_warnings(action="ignore"):  # ruamel has some for odd metadata.yaml
            reader: Any = Reader1(file) if ros1 else Reader2(file)
            reader.open()
        with closing(reader):
            # These types are alike in all distributions: those that the bag holds are not needed.
            store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
            if ros1:  # its TFMessage is missing
                transforms = "geometry_msgs/TransformStamped[] transforms"
                store.register(get_types_from_msg(transforms, Kind.TF))
            yield Bag(reader, store, ros1)
    except LocplanError:
        raise
    except Exception as error:  # rosbags lets errors of many kinds out where a bag is damaged
        lines = str(error).strip().splitlines() or [type(error).__name__]
        reason = lines[0].replace(f"{str(file)!r} ", "").replace(str(file), "it").rstrip(".")[:200]
        mender = MENDERS.get(file.suffix)
        remedy = f"mend it with `{mender}`" if mender else "record it again"
        raise RecordingError(f"cannot be read as a bag ({reason}); {remedy}") from None


def storage_of(path: Path) -> Path:
    """The file or folder that is read: a folder without metadata.yaml stands for its only file."""
    if not path.is_dir() or (path / "metadata.yaml").exists():
        return path
    files = sorted(each for each in path.iterdir() if each.suffix in SUFFIXES)
    if len(files) != 1:
        found = ", ".join(each.name for each in files) or "no bag"
        raise RecordingError(f"is a folder without metadata.yaml, with {found}; name one file")
    return files[0]


@cache
def bound_unpacking(ros1: Any, ros2: Any, mcap: Any) -> None:
    """Put bounds on the functions by which these modules of rosbags unpack, which have none."""
    from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

    lz4 = partial(_unpacked, LZ4FrameDecompressor)
    ros1.decompressors.update(bz2=partial(_unpacked, BZ2Decompressor), lz4=lz4)
    mcap.DECOMPRESSORS["lz4"] = lz4
    zstd: Any = getattr(ros2, "zstd", None)
    if zstd is not None:  # older ones unpack no more than a chunk says of itself
        unpacked = partial(_unpacked, zstd.ZstdDecompressor)
        mcap.DECOMPRESSORS["zstd"] = unpacked
        whole_file = partial(_whole_file, zstd.open)
        vars(ros2)["zstd"] = SimpleNamespace(open=whole_file, decompress=unpacked)


def _unpacked(kind: Callable[[], Any], packed: bytes, _: int = 0) -> bytes:
    """Content of a chunk, which may consist of several frames."""
    parts, room = list[bytes](), MAX_CHUNK_BYTES
    while packed:
        frame = kind()
        parts.append(frame.decompress(packed, room + 1))
        room -= len(parts[-1])
        if room < 0:
            raise RecordingError(f"a chunk unpacks to over {MAX_CHUNK_BYTES / 1e6:.0f} MB")
        if not frame.eof:
            raise RecordingError("a chunk is cut off or damaged; record it again")
        packed = frame.unused_data
    return b"".join(parts)


@contextmanager
def _whole_file(unpack: Callable[..., Any], file: BufferedReader, mode: str) -> Iterator[Any]:
    """A packed file that is open for reading, up to its greatest size."""
    left = MAX_RATIO * os.fstat(file.fileno()).st_size

    def read(count: int) -> bytes:
        nonlocal left
        part: bytes = content.read(count)
        left -= len(part)
        if left < 0:
            raise RecordingError(f"it unpacks to over {MAX_RATIO} times its size; unpack it first")
        return part

    with unpack(file, mode) as content:
        yield SimpleNamespace(read=read)
