"""Files as drones and robots record them, for tests: a ULog written byte by byte from its specification, and bags."""

import struct

import numpy as np


def write_ulog(path, topics):
    """``topics``: (name, instance, {field: (N,) or (N, k) array}) with ``timestamp`` in µs, the rest floats."""

    def message(kind, payload):
        return struct.pack("<HB", len(payload), ord(kind)) + payload

    content = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    formats = {}
    for name, _, fields in topics:
        parts = [
            "uint64_t timestamp"
            if field == "timestamp"
            else f"float{''.join(f'[{size}]' for size in np.shape(values)[1:])} {field}"
            for field, values in fields.items()
        ]
        formats[name] = f"{name}:{';'.join(parts)};"
    for text in formats.values():
        content += message("F", text.encode())
    for number, (name, instance, _) in enumerate(topics):
        content += message("A", struct.pack("<BH", instance, number) + name.encode())
    rows = []
    for number, (_, _, fields) in enumerate(topics):
        for i, stamp in enumerate(fields["timestamp"]):
            data = struct.pack("<H", number)
            for field, values in fields.items():
                data += struct.pack("<Q", stamp) if field == "timestamp" else np.float32(values[i]).tobytes()
            rows.append((stamp, message("D", data)))
    path.write_bytes(content + b"".join(data for _, data in sorted(rows, key=lambda row: row[0])))


def write_bag(path, kind, stamps, rates, forces, fields):
    """Imu messages on /imu/data and, at every second stamp, MagneticField on /imu/mag. ``stamps`` in ns."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
    types = store.types

    def header(stamp):
        time = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
        if kind == "ros1":
            return types["std_msgs/msg/Header"](0, time, "imu")
        return types["std_msgs/msg/Header"](time, "imu")

    vector, nine = types["geometry_msgs/msg/Vector3"], np.zeros(9)
    plugin = {"sqlite3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}.get(kind)
    opened = Writer1(path) if kind == "ros1" else Writer2(path, version=8, storage_plugin=plugin)
    serialize = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
    with opened as writer:
        imu = writer.add_connection("/imu/data", "sensor_msgs/msg/Imu", typestore=store)
        mag = writer.add_connection("/imu/mag", "sensor_msgs/msg/MagneticField", typestore=store)
        for i, stamp in enumerate(stamps):
            message = types["sensor_msgs/msg/Imu"](
                header(stamp),
                types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
                nine,
                vector(*rates[i]),
                nine,
                vector(*forces[i]),
                nine,
            )
            # The bag takes it 2 ms later.
            writer.write(imu, stamp + 2_000_000, serialize(message, "sensor_msgs/msg/Imu"))
            if i % 2 == 0:
                message = types["sensor_msgs/msg/MagneticField"](header(stamp), vector(*fields[i]), nine)
                writer.write(mag, stamp + 2_000_000, serialize(message, "sensor_msgs/msg/MagneticField"))
