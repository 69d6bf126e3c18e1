"""Reads a run folder with TensorBoard's own reader and compares it with metrics.jsonl: every step once, the same numbers.

pip install tensorboard; python scripts/reference/tensorboard_read.py RUN
"""
import json
import struct
import sys
from pathlib import Path

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator


def main(run):
    events = EventAccumulator(str(run), size_guidance={"scalars": 0, "tensors": 0})
    events.Reload()
    lines = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    single = lambda x: struct.unpack("<f", struct.pack("<f", x))[0]
    tags = {
        "train/loss": ("train", "loss"),
        "train/bits_per_frame": ("train", "bits_per_frame"),
        "train/rate": ("train", "rate"),
        "train/gradient_norm": ("train", "gradient_norm"),
        "valid/bits_per_frame": ("valid", "bits_per_frame"),
        "valid/loss": ("valid", "nats_per_token"),
    }
    for tag, (kind, key) in tags.items():
        expected = [(line["step"], single(line[key])) for line in lines if line["kind"] == kind]
        found = [(event.step, event.value) for event in events.Scalars(tag)]
        assert found == expected, f"{tag}: {len(found)} events, {len(expected)} lines; {set(found) ^ set(expected)}"
        print(f"{tag}: {len(found)} values as in metrics.jsonl")
    text = events.Tensors("config")[-1].tensor_proto.string_val[0].decode()
    expected = "".join(f"    {line}\n" for line in (run / "config.toml").read_text().splitlines())
    assert text == expected, text
    print("config: the text of config.toml")


main(Path(sys.argv[1]))
