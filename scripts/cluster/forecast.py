"""The linear forecast of a frame's steps (crates/model/src/forecast), in whole numbers.

B windows, F frames with those before the window, C slots. Sums are of f64, which has all whole numbers that come up.
"""
import torch
from torch import nn
from torch.nn import functional as F

LAGS, ERRORS, BIN = 4, 16, 1 << 16
HISTORY = ERRORS + LAGS + 1
KNOTS = [-s for s in reversed([BIN // 4 << i for i in range(9)])] + [0] + [BIN // 4 << i for i in range(9)]
PARTS = [-BIN // 2, -BIN // 4, 0, BIN // 4, BIN // 2]
NUMBERS = 3 * len(KNOTS) + len(PARTS)


class Forecast(nn.Module):
    """Coefficients, which nothing trains: `all` (LAGS + 1, LAGS C + 1 + C, C) and `own` (LAGS + 1, LAGS + 1, C)."""

    def __init__(self, slots):
        super().__init__()
        self.register_buffer("all", torch.zeros(LAGS + 1, LAGS * slots + 1 + slots, slots))
        self.register_buffer("own", torch.zeros(LAGS + 1, LAGS + 1, slots))

    def forward(self, bins, count, circular):
        """(B, F, C) forecasts, in parts of a bin, of bins (B, F, C), -1 where there is none; frames begin with padding."""
        B, T, C = bins.shape
        limit = (count // 9).clamp(min=1)
        before = F.pad(bins, (0, 0, 1, 0), value=-1)[:, :T]
        d = steps(before, bins, count, circular).double()  # (B, F, C)
        there = (bins >= 0).any(2)
        known = (there.long().cumsum(1) - 2).clamp(-1, LAGS)  # frames of steps before each frame; -1: none has a forecast
        known = torch.where(there, known, -1)
        lag = torch.stack([F.pad(d, (0, 0, i, 0))[:, :T] for i in range(1, LAGS + 1)], 2)  # (B, F, LAGS, C)
        earlier = torch.triu(torch.ones(C, C, dtype=torch.float64, device=d.device), 1)  # a slot reads those before it
        both = d.new_zeros(2, B, T, C)
        for k in range(LAGS + 1):
            w, own = self.all[k].double(), self.own[k].double()
            seen = lag[:, :, :k].flatten(2)
            of_all = seen @ w[: k * C] + w[LAGS * C] + d @ (w[LAGS * C + 1 :] * earlier)
            of_own = (lag[:, :, :k] * own[:k]).sum(2) + own[LAGS]
            both = torch.where((known == k)[None, ..., None], torch.stack([of_all, of_own]), both)
        most = limit * BIN
        both = both.clamp(-(3 * most) // 2, 3 * most // 2).long()
        error = (d.long() * BIN - both).abs().minimum(most)
        counts = (known >= 0)[..., None] & (bins >= 0) & (before >= 0)
        total = F.pad(torch.where(counts, error, 0).cumsum(2), (0, 0, ERRORS + 1, 0))
        errors = total[:, :, ERRORS : ERRORS + T] - total[:, :, :T] + BIN  # of the last frames, and a bin
        # the leading eight bits of the larger one decide
        bits = torch.floor(torch.log2(errors.amax(0).double())).long() + 1
        share = (errors >> (bits - 8).clamp(min=0)).clamp(min=1) ** 4
        mean = (both[0] * share[1] + both[1] * share[0]).div(share[0] + share[1], rounding_mode="floor")
        return torch.where((known >= 0)[..., None], mean, 0)


def steps(before, bins, count, circular):
    """Steps (B, F, C) from bins to bins, the short way round a circle, at most a ninth of the bins; 0 where one isn't known."""
    by = bins - before
    by = torch.where(circular > 0, (by + count // 2) % count - count // 2, by)
    most = (count // 9).clamp(min=1)
    return torch.where((bins >= 0) & (before >= 0), by.clamp(-most, most), 0)


def reached(bins, forecast, count, circular):
    """Where forecasts lead from bins: round the circle, or up to the last; -1 where there is no bin."""
    to = bins + ((forecast + BIN // 2) >> 16)
    to = torch.where(circular > 0, to % count, to.minimum(count - 1).clamp(min=0))
    return torch.where(bins >= 0, to, -1)


def numbers(forecast, last):
    """What the decoder reads of a forecast (.., NUMBERS), with the slot's last step in bins."""
    last, fraction = last * BIN, forecast - (((forecast + BIN // 2) >> 16) << 16)
    return torch.cat([tents(x, k) for x, k in [(forecast, KNOTS), (forecast - last, KNOTS), (last, KNOTS), (fraction, PARTS)]], -1)


def tents(x, knots):
    """Where between the knots a number is: 1 at its own, falling to 0 at its neighbours."""
    k = torch.tensor(knots, device=x.device)
    x = x.clamp(knots[0], knots[-1])
    above = torch.bucketize(x, k, right=True).clamp(1, len(knots) - 1)
    share = ((x - k[above - 1]).float() / (k[above] - k[above - 1]).float())[..., None]
    out = torch.zeros(*x.shape, len(knots), device=x.device)
    return out.scatter(-1, above[..., None] - 1, 1 - share).scatter(-1, above[..., None], share)
