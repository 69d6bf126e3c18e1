"""TensorBoard records as tensorboard's own classes write them: crates/train/tests/golden/tensorboard_event.json.

pip install tensorboard; python scripts/reference/tensorboard_event.py
"""
import io
import json
from pathlib import Path

import tensorboard
from tensorboard.compat.proto.event_pb2 import Event, SessionLog
from tensorboard.compat.proto.summary_pb2 import DATA_CLASS_TENSOR, Summary, SummaryMetadata
from tensorboard.compat.proto.tensor_pb2 import TensorProto
from tensorboard.compat.proto.tensor_shape_pb2 import TensorShapeProto
from tensorboard.compat.proto.types_pb2 import DT_STRING
from tensorboard.summary.writer.record_writer import RecordWriter


def record(**event):
    out = io.BytesIO()
    RecordWriter(out).write(Event(wall_time=2.5, step=300, **event).SerializeToString())
    return out.getvalue().hex()


scalars = [Summary.Value(tag="loss", simple_value=1.25), Summary.Value(tag="rate", simple_value=-3.0)]
metadata = SummaryMetadata(plugin_data=SummaryMetadata.PluginData(plugin_name="text"), data_class=DATA_CLASS_TENSOR)
tensor = TensorProto(dtype=DT_STRING, tensor_shape=TensorShapeProto(), string_val=[b"    a = 1\n    [b]\n"])
golden = {
    "script": "scripts/reference/tensorboard_event.py",
    "versions": {"tensorboard": tensorboard.__version__},
    "record": record(summary=Summary(value=scalars)),
    "start": record(session_log=SessionLog(status=SessionLog.START)),
    "text": record(summary=Summary(value=[Summary.Value(tag="config", metadata=metadata, tensor=tensor)])),
}
path = Path(__file__).resolve().parents[2] / "crates/train/tests/golden/tensorboard_event.json"
path.write_text(json.dumps(golden, indent=1) + "\n")
