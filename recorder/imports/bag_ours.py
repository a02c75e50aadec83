"""What a session holds beside pictures, in a bag: JSON in std_msgs/String, so that nothing is lost.

ROS has no messages for a range reading's raw text, an apple's truth or a recorder's losses. Our
export writes them under /pomolog, and label pictures under /truth, for our import to find.
"""

from typing import Final

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.json_format import MessageToJson, Parse

from recorder.imports.bag import OURS, Bag, Topic
from recorder.imports.bag_messages import decode
from recorder.mcap_records import RawMessage, reporting_damage
from recorder.messages import timestamp_of
from recorder.profile import PROFILE, TOPICS

AS_JSON: Final = (
    "/rangefinder", "/truth/apples", "/notes", "/recorder/status", "/recorder/stamps",
)  # fmt: skip
LABELS: Final = ("/truth/left", "/truth/right")


def to_json(message: RawMessage) -> str:
    """A message of ours as one line of JSON."""
    decoded = TOPICS[message.topic].FromString(message.data)
    return MessageToJson(decoded, indent=None, preserving_proto_field_name=True)


def our_topics(bag: Bag) -> tuple[str, ...]:
    """The topics of a bag that our export made of messages of ours."""
    if bag.metadata.get("profile") != PROFILE:
        return ()
    wanted = {*(f"{OURS}{topic}" for topic in AS_JSON), *LABELS}
    return tuple(name for name in bag.topics if name in wanted)


def from_bag(bag: Bag, topic: Topic, message: RawMessage) -> RawMessage:
    """The message of ours behind one of the bag's.

    Raises:
        PomologError: it is damaged.
    """
    with reporting_damage(bag.path, f"a message of {topic.name}", "export it again"):
        found = decode(topic, message)
        name = topic.name.removeprefix(OURS)
        if name in LABELS:
            image = CompressedImage(
                timestamp=timestamp_of(message.log_ns),
                frame_id=name.rsplit("/", 1)[-1],
                data=found.data,
                format="png",
            )
            data = image.SerializeToString()
        else:
            if not isinstance(found, str):
                raise ValueError("no text")
            data = Parse(found, TOPICS[name]()).SerializeToString()
    return RawMessage(name, message.log_ns, message.publish_ns, message.sequence, data)
