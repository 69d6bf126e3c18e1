#!/usr/bin/env python3
"""Golden numbers for crates/baselines/src/aclstm/golden.rs: an auto-conditioned LSTM of PyTorch's LSTMCells and its autograd, in f64.

    python3 aclstm.py > ../../crates/baselines/tests/golden/aclstm.json

Needs torch. No randomness: weights and sequences are sines, rounded to f32, that the test writes down again. Each case is
a form of writing a pose and a way of joining layers: the outputs of a sequence of which some steps see the network's own
output, the loss, every gradient, and the losses of ten updates by torch.optim.Adam.
"""
import json, math, sys
import torch

D, L, B, RATE = 5, 3, 2, 0.01
GIVEN = [True, True, False, False, False, True, False, True]
FORMS = {"positional": 6, "euler": 9, "quaternion": 11}


def numbers(salt, *shape):
    """Numbers within 0.4 of 0, as f32 has them."""
    k = torch.arange(math.prod(shape), dtype=torch.float64)
    return (0.4 * torch.sin(1.7 * k + 0.9 * salt)).to(torch.float32).to(torch.float64).reshape(shape)


class Network(torch.nn.Module):
    def __init__(self, channels, compat):
        super().__init__()
        self.compat = compat
        sizes = [channels] + [D] * (L - 1)
        self.cells = torch.nn.ModuleList(torch.nn.LSTMCell(size, D, dtype=torch.float64) for size in sizes)
        self.output = torch.nn.Linear(D, channels, dtype=torch.float64)
        with torch.no_grad():
            for salt, tensor in enumerate(self.tensors()):
                # ours are (in, out)
                own = numbers(salt, *reversed(tensor.shape))
                tensor.copy_(own.T if own.dim() == 2 else own)

    def tensors(self):
        for cell in self.cells:
            yield from (cell.weight_ih, cell.weight_hh, cell.bias_ih, cell.bias_hh)
        yield from (self.output.weight, self.output.bias)

    def forward(self, inputs):
        states = [(torch.zeros(B, D, dtype=torch.float64),) * 2 for _ in range(L)]
        outputs, last = [], torch.zeros_like(inputs[0])
        for given, x in zip(GIVEN, inputs):
            x = x if given else last
            before = [h for h, _ in states]
            for layer, cell in enumerate(self.cells):
                below = x if layer == 0 else before[layer - 1] if self.compat else states[layer - 1][0]
                states[layer] = cell(below, states[layer])
            last = self.output(states[-1][0])
            outputs.append(last)
        return torch.stack(outputs)


def loss(form, found, truth):
    if form == "positional":
        return torch.nn.functional.mse_loss(found, truth)
    hip = torch.nn.functional.mse_loss(found[..., :3], truth[..., :3])
    found, truth = found[..., 3:], truth[..., 3:]
    if form == "euler":
        return hip + (1 - torch.cos(found - truth)).mean()
    of = lambda q: torch.nn.functional.normalize(q.unflatten(-1, (-1, 4)), dim=-1)
    product = (of(found) * of(truth)).sum(-1).abs()
    return hip + (2 * torch.arccos(torch.clamp(product, max=1 - 1e-7))).mean()


def case(form, compat):
    channels = FORMS[form]
    network = Network(channels, compat)
    adam = torch.optim.Adam(network.parameters(), lr=RATE)
    losses, first = [], None
    for step in range(10):
        sequence = numbers(100 + step, len(GIVEN) + 1, B, channels)
        adam.zero_grad()
        outputs = network(sequence[:-1])
        found = loss(form, outputs, sequence[1:])
        found.backward()
        losses.append(found.item())
        if first is None:
            # ours are (in, out)
            gradients = [(t.grad.T if t.grad.dim() == 2 else t.grad).flatten().tolist() for t in network.tensors()]
            first = {"outputs": outputs.flatten().tolist(), "gradients": gradients}
        adam.step()
    return {"form": form, "compat": compat, "channels": channels, **first, "losses": losses}


def rounded(value):
    if isinstance(value, float):
        return float(f"{value:.9g}")
    if isinstance(value, list):
        return [rounded(v) for v in value]
    return {k: rounded(v) for k, v in value.items()} if isinstance(value, dict) else value


head = {"made_by": f"scripts/reference/aclstm.py, torch {torch.__version__}", "width": D, "layers": L, "batch": B,
        "rate": RATE, "given": GIVEN}
cases = [case(form, compat) for form in FORMS for compat in (False, True)]
json.dump(rounded({**head, "cases": cases}), sys.stdout)
print()
