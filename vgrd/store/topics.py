"""What is in a segment: four topics, three of them JSON that Foxglove opens."""

from enum import IntEnum
from typing import IO, NamedTuple

from mcap.writer import CompressionType, Writer
from scipy.spatial.transform import Rotation

from vgrd.devices import FlangeReading
from vgrd.geometry import Pose
from vgrd.store.encoding import canonical, encode

_NS = 1_000_000_000  # in a second


class Topic(IntEnum):
    """MCAP channel ids, the same in every file: a damaged one needs no index to be read."""

    FLANGE = 1  # recordings hold these numbers: none is ever changed
    OBSERVATION = 2  # idem
    IMAGE = 3  # idem
    MOVING = 4  # idem; versions that know three leave it out


class _Channel(NamedTuple):
    name: str
    encoding: str
    schema: str
    json_schema: object


_NUMBERS_XYZ = {axis: {"type": "number"} for axis in "xyz"}
_POSE_IN_FRAME = {
    "type": "object",
    "title": "foxglove.PoseInFrame",
    "properties": {
        "timestamp": {
            "type": "object",
            "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
        },
        "frame_id": {"type": "string"},
        "pose": {
            "type": "object",
            "properties": {
                "position": {"type": "object", "properties": _NUMBERS_XYZ},
                "orientation": {
                    "type": "object",
                    "properties": _NUMBERS_XYZ | {"w": {"type": "number"}},
                },
            },
        },
        "reading": {"type": "object"},
    },
}
_CHANNELS = {
    Topic.FLANGE: _Channel("/flange", "json", "foxglove.PoseInFrame", _POSE_IN_FRAME),
    Topic.OBSERVATION: _Channel("/observation", "json", "vgrd.Observation", {"type": "object"}),
    Topic.IMAGE: _Channel("/image", "vgrd-image-1", "", None),
    Topic.MOVING: _Channel("/moving", "json", "vgrd.MovingSight", {"type": "object"}),
}


def open_writer(stream: IO[bytes]) -> Writer:
    """MCAP writer with the channels of `Topic` registered."""
    writer = Writer(stream, compression=CompressionType.NONE)
    writer.start(library="vgrd")
    for topic, channel in _CHANNELS.items():
        schema = (
            writer.register_schema(channel.schema, "jsonschema", canonical(channel.json_schema))
            if channel.schema
            else 0
        )
        if writer.register_channel(channel.name, channel.encoding, schema) != topic:
            raise AssertionError(f"{topic!r} is not in the order of its id")
    return writer


def pose_in_frame(reading: FlangeReading, time_ns: int) -> bytes:
    """foxglove.PoseInFrame (metres) of a reading, with the reading itself to the last bit."""
    pose: Pose = reading.base_from_wrist
    x, y, z, w = Rotation.from_matrix(pose.rotation).as_quat().tolist()
    position_m = (pose.translation / 1000).tolist()
    message = {
        "timestamp": {"sec": time_ns // _NS, "nsec": time_ns % _NS},
        "frame_id": "base",
        "pose": {
            "position": dict(zip("xyz", position_m, strict=True)),
            "orientation": {"x": x, "y": y, "z": z, "w": w},
        },
        "reading": encode(reading, "flange"),
    }
    return canonical(message)
