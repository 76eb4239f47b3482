"""Makes the files beside it, by the libraries that people use: pip install numpy scipy pyarrow mcap mcap-ros2-support zstandard."""

import csv, gzip, io, json, pathlib

import numpy, pyarrow, pyarrow.feather, pyarrow.ipc, pyarrow.parquet, scipy.io, zstandard
from mcap.writer import CompressionType, Writer as Plain
from mcap_ros2.writer import Writer as Ros2

HERE = pathlib.Path(__file__).parent
LOG = HERE / "../../../../src/tour/wrist-1.csv"

JOINT_STATE = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""

rows = list(csv.reader(LOG.open()))
names, rows = rows[0], [[float(cell) for cell in row] for row in rows[1:]]
columns = {name: [row[place] for row in rows] for place, name in enumerate(names)}
table = pyarrow.table(columns)


def state(time_ns, joints, position=(), velocity=(), effort=()):
    stamp = {"sec": time_ns // 10**9, "nanosec": time_ns % 10**9}
    return {"header": {"stamp": stamp, "frame_id": "base"}, "name": list(joints), "position": list(position),
            "velocity": list(velocity), "effort": list(effort)}


def ros2(path, messages, compression=CompressionType.ZSTD):
    """Messages: (topic, time of logging (ns), joint state)."""
    with open(path, "wb") as file:
        writer = Ros2(file, compression=compression)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        for topic, logged, message in messages:
            writer.write_message(topic, schema, message, log_time=logged, publish_time=logged)
        writer.finish()


# The tour's first log.
text = LOG.read_bytes()
(HERE / "wrist-1.csv.gz").write_bytes(gzip.compress(text, mtime=0))
(HERE / "wrist-1.csv.zst").write_bytes(zstandard.compress(text))
pyarrow.parquet.write_table(table, HERE / "wrist-1.parquet", compression="zstd", row_group_size=300)
pyarrow.feather.write_feather(table, HERE / "wrist-1.feather", compression="zstd", chunksize=300)
scipy.io.savemat(HERE / "wrist-1.mat", columns, do_compression=True)
START = 1_700_000_000 * 10**9
joints = [f"joint_{joint}" for joint in range(6)]
whole = [("/joint_states", START + round(row[0] * 1e9) + 5_000_000,
          state(START + round(row[0] * 1e9), joints, position=row[7:13], effort=row[1:7])) for row in rows]
ros2(HERE / "wrist-1.mcap", whole)

# Kinds of columns.
NS = numpy.array([START, START + 1_500_000, START + 3_000_000], dtype="datetime64[ns]")
kinds = pyarrow.table({
    "name": ["a", "b", "c"],
    "stamp": pyarrow.array(NS),
    "ms": pyarrow.array([1000, None, 1002], pyarrow.timestamp("ms", tz="UTC")),
    "int": pyarrow.array([-1, None, 3], pyarrow.int16()),
    "large": pyarrow.array([1, 2**63, 3], pyarrow.uint64()),
    "single": pyarrow.array([0.5, float("nan"), -2], pyarrow.float32()),
    "on": [True, False, None],
    "q": pyarrow.array([[1.0, 2.0], [3.0, None], None], pyarrow.list_(pyarrow.float64())),
    "fixed": pyarrow.array([[1, 2], [3, 4], [5, 6]], pyarrow.list_(pyarrow.int32(), 2)),
    "arm": pyarrow.array([{"tau": 1.0, "note": "x"}, {"tau": None, "note": "y"}, {"tau": 3.0, "note": "z"}]),
})
pyarrow.parquet.write_table(kinds, HERE / "kinds.parquet", compression="snappy", row_group_size=2)
pyarrow.parquet.write_table(kinds, HERE / "kinds-lz4.parquet", compression="lz4", data_page_version="2.0", use_dictionary=False)
pyarrow.parquet.write_table(kinds, HERE / "kinds-gzip.parquet", compression="gzip")
pyarrow.feather.write_feather(kinds, HERE / "kinds.arrow", compression="lz4", chunksize=2)
nights = pyarrow.table({
    "robot": ["a", "b", "c"],
    "night": pyarrow.array(["2026-03-01T00:00:00", "2026-03-02T00:00:01.5", None], pyarrow.string()).cast(pyarrow.timestamp("ms")),
})
# As older writers have them: days and nanoseconds, and no logical type.
pyarrow.parquet.write_table(nights, HERE / "nights-int96.parquet", use_deprecated_int96_timestamps=True)
with pyarrow.ipc.new_stream(HERE / "kinds-stream.arrow", kinds.schema) as stream:
    stream.write_table(kinds, max_chunksize=2)
ragged = pyarrow.table({"t": [0.0, 1.0], "q": [[1.0, 2.0], [3.0]]})
pyarrow.parquet.write_table(ragged, HERE / "ragged.parquet")
pyarrow.feather.write_feather(ragged, HERE / "ragged.arrow", compression="uncompressed")

# Kinds of variables.
scipy.io.savemat(HERE / "kinds.mat", {
    "t": numpy.arange(4) * 0.5, "q": numpy.arange(8.0).reshape(4, 2), "wide": numpy.arange(12, dtype="int16").reshape(3, 4),
    "on": numpy.array([[True], [False], [True], [True]]), "gain": 3.0, "note": "text", "z": numpy.array([1j, 2, 3, 4]),
    "arm": {"tau": numpy.array([[1.0], [2.0], [3.0], [4.0]], dtype="float32"), "deep": {"u": numpy.arange(4, dtype="uint8")}},
    "out": numpy.array([({"v": numpy.ones(4)},), ({"v": numpy.zeros(4)},)], dtype=[("s", "O")]),
    "cube": numpy.arange(4.0).reshape(1, 1, 4),
})

# Two topics of different rates, the states out of order and without a stamp of the second machine in `unstamped.mcap`.
MS = 10**6
arm = ["shoulder", "elbow"]
states = [("/joint_states", START + k * 10 * MS, state(START + k * 10 * MS, arm, position=[k, 10 + k], velocity=[1, 2]))
          for k in (0, 2, 1, 3, 4)]
commands = [("/commands", START + k * MS, state(START + k * MS, arm, effort=[k, -k])) for k in (5, 15, 35)]
gripper = [("/joint_states", START + k * MS, state(START + k * MS, ["finger"], position=[k / 1000])) for k in (0, 20, 36)]
ros2(HERE / "joined.mcap", states + commands + gripper, CompressionType.LZ4)
ros2(HERE / "unstamped.mcap", [(topic, logged + 100, {**message, "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}})
                               for topic, logged, message in states], CompressionType.NONE)
with open(HERE / "json.mcap", "wb") as file:
    writer = Plain(file)
    writer.start()
    schema = writer.register_schema("foxglove.JointStates", "jsonschema", b"{}")
    channel = writer.register_channel("/joints", "json", schema)
    other = writer.register_channel("/text", "json", schema)
    for k in range(3):
        own = {"timestamp": {"sec": 10, "nsec": k * 1000}, "joints": [{"name": "a", "position": k, "effort": -k}]}
        writer.add_message(channel, k, json.dumps(own).encode(), k)
        writer.add_message(other, k, b'{"text": "hello"}', k)
    writer.finish()
