"""One TensorBoard record as tensorboard's own classes write it: tests/golden/tensorboard_event.json.

pip install tensorboard; python scripts/reference/tensorboard_event.py
"""
import io
import json
from pathlib import Path

import tensorboard
from tensorboard.compat.proto.event_pb2 import Event
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.record_writer import RecordWriter

summary = Summary(value=[Summary.Value(tag="loss", simple_value=1.25), Summary.Value(tag="rate", simple_value=-3.0)])
event = Event(wall_time=2.5, step=300, summary=summary)
out = io.BytesIO()
RecordWriter(out).write(event.SerializeToString())
golden = {
    "script": "scripts/reference/tensorboard_event.py",
    "versions": {"tensorboard": tensorboard.__version__},
    "record": out.getvalue().hex(),
}
path = Path(__file__).resolve().parents[2] / "tests/golden/tensorboard_event.json"
path.write_text(json.dumps(golden, indent=1) + "\n")
