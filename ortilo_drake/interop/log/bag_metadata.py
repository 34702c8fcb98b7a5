"""The metadata.yaml of a rosbag2 folder, version 9, as ROS 2 Jazzy writes it."""

from typing import Any

import yaml

from ortilo_drake.interop.ros.ros_messages import LATCHED
from ortilo_drake.interop.ros.ros_types import typestore

_NO_TIME = {"sec": 0, "nsec": 0}


def quality_of_service(topic: str) -> list[dict[str, Any]]:
    """Return the quality of service a topic is offered with: reliable, and kept for latecomers if it is sent once."""
    return [
        {
            "history": "keep_last",
            "depth": 1 if topic in LATCHED else 10,
            "reliability": "reliable",
            "durability": "transient_local" if topic in LATCHED else "volatile",
            "deadline": dict(_NO_TIME),
            "lifespan": dict(_NO_TIME),
            "liveliness": "automatic",
            "liveliness_lease_duration": dict(_NO_TIME),
            "avoid_ros_namespace_conventions": False,
        }
    ]


def bag_metadata(file: str, topics: dict[str, str], counts: dict[str, int], end: int) -> str:
    """Return metadata.yaml.

    Args:
        file: the name of the MCAP file beside it.
        topics: the type of each topic.
        counts: how many messages each topic has.
        end: time of the last message; the first is at 0 [ns].
    """
    times = {"duration": {"nanoseconds": end}, "starting_time": {"nanoseconds_since_epoch": 0}}
    total = sum(counts.values())
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        "relative_file_paths": [file],
        **times,
        "message_count": total,
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic,
                    "type": type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": quality_of_service(topic),
                    "type_description_hash": typestore().hash_rihs01(type_name),
                },
                "message_count": counts[topic],
            }
            for topic, type_name in topics.items()
        ],
        "compression_format": "",
        "compression_mode": "",
        "files": [{"path": file, **times, "message_count": total}],
        "custom_data": None,
        "ros_distro": "jazzy",
    }
    return yaml.dump({"rosbag2_bagfile_information": information}, Dumper=_NoAliases, sort_keys=False)


class _NoAliases(yaml.SafeDumper):
    """A dumper without aliases: an object that occurs twice is written out twice."""

    def ignore_aliases(self, data: Any) -> bool:
        """Return True: nothing is written as an alias (PyYAML's hook)."""
        return True
