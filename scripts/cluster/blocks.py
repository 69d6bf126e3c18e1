"""What models are built of: tables, linear layers, pre-norm blocks, under kinelm's names. Matrices are (in, out)."""
import math

import torch
from torch import nn
from torch.nn import functional as F


class Table(nn.Module):
    """Rows of D numbers, Normal(0, 0.02)."""

    def __init__(self, rows, width):
        super().__init__()
        self.weight = nn.Parameter(0.02 * torch.randn(rows, width))

    def forward(self, rows):
        return F.embedding(rows, self.weight)


class Linear(nn.Module):
    def __init__(self, i, o, sd=0.02):
        super().__init__()
        self.weight = nn.Parameter(sd * torch.randn(i, o))
        self.bias = nn.Parameter(torch.zeros(o))

    def forward(self, x):
        return F.linear(x, self.weight.T, self.bias)


class Projection(Table):
    """A matrix without a bias, which begins as zeros and learns as tables do."""

    def __init__(self, i, o):
        super().__init__(i, o)
        nn.init.zeros_(self.weight)

    def forward(self, x):
        return x @ self.weight


class Attention(nn.Module):
    def __init__(self, c, residual):
        super().__init__()
        self.heads, self.causal, self.dropout = c.heads, c.kind == "causal", c.dropout
        self.qkv, self.out = Linear(c.width, 3 * c.width), Linear(c.width, c.width, residual)

    def forward(self, x, turn):
        B, T, D = x.shape
        q, k, v = self.qkv(x).view(B, T, 3, self.heads, D // self.heads).permute(2, 0, 3, 1, 4)  # (B, H, T, d) each
        if turn is not None:
            q, k = rotate(q, turn).to(v.dtype), rotate(k, turn).to(v.dtype)
        share = self.dropout if self.training else 0.0
        mixed = F.scaled_dot_product_attention(q, k, v, is_causal=self.causal, dropout_p=share)
        return self.out(mixed.transpose(1, 2).reshape(B, T, D))


class Mlp(nn.Module):
    def __init__(self, c, residual):
        super().__init__()
        self.up, self.down = Linear(c.width, 4 * c.width), Linear(4 * c.width, c.width, residual)

    def forward(self, x):
        return self.down(F.gelu(self.up(x), approximate="tanh"))


class Block(nn.Module):
    """A block of a stack `c` with layers, heads, width, kind and dropout."""

    def __init__(self, c):
        super().__init__()
        residual = deviation("out", c.layers)
        self.norm1, self.norm2 = nn.LayerNorm(c.width, 1e-5), nn.LayerNorm(c.width, 1e-5)
        self.attention, self.mlp, self.drop = Attention(c, residual), Mlp(c, residual), nn.Dropout(c.dropout)

    def forward(self, x, turn=None):
        x = x + self.drop(self.attention(self.norm1(x), turn))
        return x + self.drop(self.mlp(self.norm2(x)))


def stack(c):
    return nn.ModuleDict({f"{layer:02}": Block(c) for layer in range(c.layers)})


def deviation(matrix, layers):
    """What a matrix of a block begins with: those into the residual stream, `out` and `down`, with less."""
    return 0.02 / math.sqrt(2 * layers) if matrix in ("out", "down") else 0.02


def turns(frames, c, x):
    """Cosines and sines (B or 1, 1, T, d/2) of rope's angles: frame x 10000^(-2j/d)."""
    d = c.width // c.heads
    pair = widened(x).new_tensor(range(d // 2))
    angle = frames[:, None, :, None] * 10000.0 ** (-2 * pair / d)
    return angle.cos(), angle.sin()


def rotate(x, turn):
    """x (B, H, T, d) with its pairs (j, j + d/2) turned."""
    (cos, sin), (a, b) = turn, x.chunk(2, -1)
    return torch.cat([a * cos - b * sin, a * sin + b * cos], -1)


def widened(x):
    """At least f32: sums of many exponentials want it under autocast."""
    return x if x.dtype == torch.float64 else x.float()
