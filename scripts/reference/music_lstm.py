#!/usr/bin/env python3
"""Golden numbers for crates/baselines/src/music_lstm/golden.rs: a small music LSTM of PyTorch's modules and its autograd, in f64.

    python3 music_lstm.py > ../../crates/baselines/tests/golden/music_lstm.json

Needs torch. No randomness: weights, spectra and poses are sines, rounded to f32, that the test writes down again. Each case
is a pair of losses: the outputs, the loss and gradients of a first batch (of long tensors every STRIDE-th number), and the
losses of ten updates by torch.optim.Adam behind clip_grad_norm_.
"""
import json, math, sys
import torch
from torch.nn.functional import normalize

N, ENCODER, D, L, J, B, T, RATE, CLIP, FPS, STRIDE = 6150, 5, 4, 2, 2, 2, 10, 0.01, 1.0, 30, 997
TOLD = [False, True, False, False, True, True, False, False, False, True]
WEIGHTS = [1.0, 0.25]


def numbers(salt, amplitude, *shape):
    k = torch.arange(math.prod(shape), dtype=torch.float64)
    return (amplitude * torch.sin(1.7 * k + 0.9 * salt)).to(torch.float32).to(torch.float64).reshape(shape)


class Network(torch.nn.Module):
    def __init__(self):
        super().__init__()
        of = dict(dtype=torch.float64)
        self.linear = torch.nn.ModuleList([torch.nn.Linear(N, ENCODER, **of), torch.nn.Linear(ENCODER, 4 * J, **of)])
        self.cells = torch.nn.ModuleList(torch.nn.LSTMCell(i, d, **of) for i, d in [(4 * J, D), (D, D), (D, 4 * J)])
        with torch.no_grad():
            for salt, tensor in enumerate(self.tensors()):
                # ours are (in, out)
                own = numbers(salt, 0.4, *reversed(tensor.shape))
                tensor.copy_(own.T if own.dim() == 2 else own)

    def tensors(self):
        for layer in self.linear:
            yield from (layer.weight, layer.bias)
        for cell in self.cells:
            yield from (cell.weight_ih, cell.weight_hh, cell.bias_ih, cell.bias_hh)

    def forward(self, heard, before):
        x = self.linear[1](torch.relu(self.linear[0](heard)))
        states = [(torch.zeros(B, cell.hidden_size, dtype=torch.float64),) * 2 for cell in self.cells]
        outputs = []
        for t in range(T):
            y = x[t]
            for layer, cell in enumerate(self.cells):
                h, c = states[layer]
                if layer == L and TOLD[t]:
                    h = before[t]
                states[layer] = cell(y, (h, c))
                y = states[layer][0]
            outputs.append(y)
        return torch.stack(outputs)


def product(a, b):
    (aw, ax, ay, az), (bw, bx, by, bz) = a.unbind(-1), b.unbind(-1)
    return torch.stack([aw * bw - ax * bx - ay * by - az * bz, aw * bx + ax * bw + ay * bz - az * by,
                        aw * by - ax * bz + ay * bw + az * bx, aw * bz + ax * by - ay * bx + az * bw], -1)


def conjugate(q):
    return q * torch.tensor([1.0, -1.0, -1.0, -1.0], dtype=torch.float64)


def corrected(found, truth):
    def smooth(q):
        turn = product(q[1:], conjugate(q[:-1]))
        speed = FPS * 2 * torch.atan2(turn[..., 1:].norm(dim=-1), turn[..., 0].abs())
        effort = (speed * torch.tensor(WEIGHTS, dtype=torch.float64)).sum(-1)
        return effort.unfold(0, min(8, T - 1), 1).mean(-1)
    return (torch.log1p(smooth(found)) - torch.log1p(smooth(truth))).square().mean()


def compat(found, truth):
    omega = lambda q: 2 * product(product(q[1:], conjugate(q[:-1])), conjugate(q[:-1]))
    return torch.nn.functional.mse_loss(omega(found), omega(truth))


def loss(pose, effort, outputs, truth):
    found, truth = (normalize(x.unflatten(-1, (J, 4)), dim=-1) for x in (outputs, truth))
    total = {"corrected": corrected, "compat": compat, "none": lambda *_: 0.0}[effort](found, truth)
    if pose == "aligned":
        sign = torch.where((found * truth).sum(-1, keepdim=True) < 0, -1.0, 1.0)
        total = total + torch.nn.functional.mse_loss(found, truth * sign)
    elif pose == "compat":
        total = total + torch.nn.functional.mse_loss(found, truth)
    return total


def case(pose, effort):
    network = Network()
    adam = torch.optim.Adam(network.parameters(), lr=RATE)
    losses, first = [], None
    for step in range(10):
        heard, poses = numbers(50 + step, 0.02, T, B, N), numbers(100 + step, 0.4, T + 1, B, 4 * J)
        poses = normalize(poses.unflatten(-1, (J, 4)), dim=-1).flatten(-2)
        poses = poses.to(torch.float32).to(torch.float64)
        adam.zero_grad()
        outputs = network(heard, poses[:-1])
        found = loss(pose, effort, outputs, poses[1:])
        found.backward()
        losses.append(found.item())
        if first is None:
            own = [(t.grad.T if t.grad.dim() == 2 else t.grad).flatten() for t in network.tensors()]
            gradients = [(g[::STRIDE] if len(g) > 2000 else g).tolist() for g in own]
            first = {"outputs": outputs.flatten().tolist(), "gradients": gradients}
        torch.nn.utils.clip_grad_norm_(network.parameters(), CLIP)
        adam.step()
    return {"pose": pose, "effort": effort, **first, "losses": losses}


def rounded(value):
    if isinstance(value, float):
        return float(f"{value:.9g}")
    if isinstance(value, list):
        return [rounded(v) for v in value]
    return {k: rounded(v) for k, v in value.items()} if isinstance(value, dict) else value


head = {"made_by": f"scripts/reference/music_lstm.py, torch {torch.__version__}", "rate": RATE, "clip": CLIP,
        "stride": STRIDE, "told": TOLD, "weights": WEIGHTS}
cases = [case(*pair) for pair in [("aligned", "none"), ("aligned", "corrected"), ("compat", "compat"), ("none", "corrected")]]
json.dump(rounded({**head, "cases": cases}), sys.stdout)
print()
