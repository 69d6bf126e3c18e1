#!/usr/bin/env python3
"""The same auto-conditioned LSTM in PyTorch on a CPU: one JSON line, with the fields of `kinelm-lab lstm --json`.

    torch_lstm.py [--width D] [--condition N] [--batch B] [--compile] [--whole] [--threads N] [--repeats R]

Three LSTMCells a step, 5 true frames and then N of the network's own by turns, mean square loss, fused Adam. `--whole` is
nn.LSTM over the whole sequence, which only a network that is never fed its own can be (`--condition 0`). Needs torch.
"""
import argparse, json, statistics, time

import torch
from torch import nn

CHANNELS, LENGTH, LAYERS, GROUNDTRUTH = 175, 100, 3, 5
WARM_UP = 2


class Loop(nn.Module):
    def __init__(self, width, given):
        super().__init__()
        self.width, self.given = width, given
        self.cells = nn.ModuleList(nn.LSTMCell(CHANNELS if i == 0 else width, width) for i in range(LAYERS))
        self.output = nn.Linear(width, CHANNELS)

    def forward(self, inputs):
        zero = inputs.new_zeros(inputs.shape[1], self.width)
        states = [(zero, zero)] * LAYERS
        outputs, last = [], torch.zeros_like(inputs[0])
        for given, x in zip(self.given, inputs):
            x = x if given else last
            for i, cell in enumerate(self.cells):
                states[i] = cell(x, states[i])
                x = states[i][0]
            last = self.output(x)
            outputs.append(last)
        return torch.stack(outputs)


class Whole(nn.Module):
    def __init__(self, width, given):
        super().__init__()
        assert all(given), "nn.LSTM sees true frames alone"
        self.lstm, self.output = nn.LSTM(CHANNELS, width, LAYERS), nn.Linear(width, CHANNELS)

    def forward(self, inputs):
        return self.output(self.lstm(inputs)[0])


def main():
    p = argparse.ArgumentParser()
    for name, value in [("width", 256), ("condition", 5), ("batch", 32), ("threads", 0), ("repeats", 10)]:
        p.add_argument(f"--{name}", type=int, default=value)
    p.add_argument("--compile", action="store_true")
    p.add_argument("--whole", action="store_true")
    args = p.parse_args()
    torch.manual_seed(1)
    if args.threads:
        torch.set_num_threads(args.threads)
    given = [t % (GROUNDTRUTH + args.condition) < GROUNDTRUTH for t in range(LENGTH)]
    model = (Whole if args.whole else Loop)(args.width, given)
    adam = torch.optim.Adam(model.parameters(), lr=1e-4, fused=True)
    inputs, targets = (0.1 * torch.randn(LENGTH, args.batch, CHANNELS) for _ in range(2))

    def loss():
        return nn.functional.mse_loss(model(inputs), targets)

    compute = torch.compile(loss) if args.compile else loss

    def step():
        adam.zero_grad(set_to_none=True)
        found = compute()
        found.backward()
        adam.step()
        return found.item()

    for _ in range(WARM_UP):
        step()
    seconds = []
    for _ in range(args.repeats):
        start = time.perf_counter()
        last = step()
        seconds.append(time.perf_counter() - start)
    rates = sorted(LENGTH * args.batch / s for s in seconds)
    print(json.dumps({"what": "lstm", "frames_per_s": round(statistics.median(rates), 1), "low": round(rates[0], 1),
                      "high": round(rates[-1], 1), "threads": torch.get_num_threads(), "width": args.width,
                      "condition": args.condition, "torch": torch.__version__, "last_loss": last}))


if __name__ == "__main__":
    main()
