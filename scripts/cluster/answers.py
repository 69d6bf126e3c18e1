"""What every model does with a row for each token: the frame before, heads, losses.

B windows, T tokens of a window, K of them in front, V ids, W tokens of a word (its space is the last), D numbers of a row.
A causal model's input i predicts word token k = i - (K - 1), which stands at place k mod W of its word; a masked one's
predicts the token that stands at i itself.
"""
import torch
from torch import nn
from torch.nn import functional as F

from blocks import Table, deviation, widened


def loss(logits, targets, nothing):
    """-ln p (B, R) of targets among logits (B, R, N), 0 where they are `nothing`."""
    flat = widened(logits).flatten(0, 1)
    return F.cross_entropy(flat, targets.flatten(), ignore_index=nothing, reduction="none").view_as(targets)


class Head(nn.Module):
    """`weight` (V, D) unless tied; `circular` and `clamped`: rows for the steps from the frame before."""

    def __init__(self, c, tokens, width):
        super().__init__()
        if not c.tied_head:
            self.weight = nn.Parameter(0.02 * torch.randn(tokens.vocabulary, width))
        circular, clamped = counts(tokens)
        if c.head == "relative" and circular:
            self.circular = Table(circular, width)
        if c.head == "relative" and clamped:
            self.clamped = Table(2 * clamped - 1, width)


def counts(tokens):
    """Most bins of the places that go round, and of those that don't; 0 where there are none."""
    most = lambda circular: max((n for _, n, goes in tokens.place_ids() if goes == circular), default=0)
    return most(True), most(False)


class Answers(nn.Module):
    """A model whose `states` (B, T, D) of inputs (B, T) the head reads. Called with targets, it gives their -ln p."""

    def __init__(self, config, tokens, width):
        super().__init__()
        self.config, self.tokens = config, tokens
        self.norm = nn.LayerNorm(width, 1e-5)
        self.head = Head(config, tokens, width)
        # per place of a word: first id, bins, whether they go round; the space has no bins
        kinds = torch.tensor([*tokens.place_ids(), (0, 0, 0)] if tokens.places else [(0, 0, 0)] * tokens.word)
        self.register_buffer("kinds", kinds.long(), persistent=False)
        self.plans = {}
        self.history = 0  # frames before a window that are read

    def forward(self, ids, targets=None):
        """Logits (B, T, V) of inputs (B, T), -inf where an id can't be; rows of the front that predict nothing have some.
        With targets (B, T) their -ln p, 0 where they are pad. A model that reads frames before its windows has them behind
        the front of `ids`."""
        ids, states, before = self.read(ids)
        h = self.norm(states)
        return self.logits(h, ids, before) if targets is None else self.nats(h, ids, targets, before)

    def read(self, ids):
        """The window's inputs (B, T), their states (B, T, D), and (B, T) the id that each counts its steps from, -1 for none."""
        return ids, self.states(ids), self.earlier(ids, 1)

    def ids_table(self):
        """(V, D) whose rows answer for all ids."""
        return self.head.weight

    # --- the frame before

    def earlier(self, ids, words):
        """Of every input: the id that stands `words` frames before what it predicts, -1 where there is none: (B, T)."""
        T, K, by = ids.shape[1], self.tokens.front, words * self.tokens.word
        first = K - 1 + by  # the first input with one
        found = F.pad(ids, (by - 1, 0), value=-1)[:, :T]
        return torch.where(torch.arange(T, device=ids.device) >= first, found, -1)

    def kind_of(self, T):
        """First id, bins, goes round, of the place that each of T inputs predicts: (T) each; no bins in front."""
        shift = self.tokens.front - 1 if self.config.kind == "causal" else self.tokens.front
        k = torch.arange(T, device=self.kinds.device) - shift
        return torch.where((k >= 0)[:, None], self.kinds[k % self.tokens.word], 0).unbind(1)

    # --- heads

    def logits(self, h, ids, before):
        """Logits (B, T, V) of states (B, T, D)."""
        B, T, V = *ids.shape, self.tokens.vocabulary
        if self.config.head == "absolute":
            return h @ self.ids_table().T
        plain, steps = self.plan(T)
        logits = h[:, plain] @ self.ids_table().T
        out = torch.full((B, T, V), -torch.inf, dtype=logits.dtype, device=ids.device)
        out = out.index_copy(1, plain, logits)
        for name, r, first, n in steps:  # R inputs; (R, 1) of each
            table = getattr(self.head, name).weight
            bin = torch.arange(V, device=ids.device) - first  # (R, V): j of every id
            p = (before[:, r] - first[:, 0]).unsqueeze(2)  # (B, R, 1); no bin only where nothing counts
            there = (bin >= 0) & (bin < n)
            row = (bin - p) % n if name == "circular" else bin - p + len(table) // 2
            found = (h[:, r] @ table.T).gather(2, row.clamp(0, len(table) - 1))
            found = found.masked_fill(~there, -torch.inf)
            out = out.index_copy(1, r, torch.where(before[:, r, None] >= 0, found, out[:, r]))
        return out

    def nats(self, h, ids, targets, before):
        """-ln p (B, T) of targets, 0 where they are pad, infinite where they can't be, from states (B, T, D): as from the
        logits, without making them."""
        pad = self.tokens.pad
        if self.config.head == "absolute":
            return loss(h @ self.ids_table().T, targets, pad)
        plain, steps = self.plan(ids.shape[1])
        found = loss(h[:, plain] @ self.ids_table().T, targets[:, plain], pad)
        # a table that nobody asks, in windows of one frame, has the gradient 0
        nothing = sum(0.0 * part.weight.sum() for part in self.head.children())
        out = torch.zeros_like(targets, dtype=found.dtype).index_copy(1, plain, found + nothing)
        for name, r, first, n in steps:
            table = getattr(self.head, name).weight
            some, p = targets[:, r], before[:, r] - first[:, 0]  # (B, R)
            step, row = some - first[:, 0] - p, torch.arange(len(table), device=ids.device)
            rows = h[:, r] @ table.T
            if name == "circular":
                wanted = step % n[:, 0]
                there = row < n  # (R, rows)
            else:
                wanted = step + len(table) // 2
                to = row - len(table) // 2 + p[..., None]
                there = (to >= 0) & (to < n)  # (B, R, rows)
            is_bin = (some >= first[:, 0]) & (some < first[:, 0] + n[:, 0])
            counts = before[:, r] >= 0
            wanted = torch.where(is_bin & counts & (wanted >= 0) & (wanted < len(table)), wanted, -1)
            # where nothing counts every step may come, so that no gradient is nan
            there = there | (wanted < 0)[..., None]
            found = loss(rows.masked_fill(~there, -torch.inf), wanted, -1)
            found = found.masked_fill((some != pad) & ~is_bin, torch.inf)
            out = out.index_copy(1, r, torch.where(counts, found, out[:, r]))
        return out

    def plan(self, T):
        """Of T inputs, those that the head over all ids answers, and those that each table of steps does, with the first
        id and the number of bins of their places. Found once: it would make a GPU wait."""
        if T not in self.plans:
            first, count, circular = (x.cpu() for x in self.kind_of(T))
            late = torch.arange(T) >= self.tokens.front - 1 + self.tokens.word
            # a window's first frame may count from a frame before the window
            relative, goes = (late | bool(self.history)) & (count > 0), circular > 0
            rows = lambda which: which.nonzero()[:, 0]
            tables = [("circular", rows(relative & goes)), ("clamped", rows(relative & ~goes))]
            move = lambda *all: [x.to(self.kinds.device) for x in all]
            steps = [(name, *move(r, first[r, None], count[r, None])) for name, r in tables if len(r)]
            self.plans[T] = *move(rows(~(late & (count > 0)))), steps
        return self.plans[T]

    def uncounted(self, ids):
        """(B, T) where a target may not count: the relative head has no bin one frame before."""
        if self.config.head == "absolute":
            return torch.zeros_like(ids, dtype=torch.bool)
        first, count, _ = self.kind_of(ids.shape[1])
        a = self.earlier(ids, 1)
        return (count > 0) & (a >= 0) & ~((a >= first) & (a < first + count))

    # --- what is trained

    def ordinal(self, logits, targets, width):
        """What is trained instead where bins are ordered: cross-entropy (B, T) with the target's mass spread over bins near
        it, by exp(-d^2 / (2 width^2)) up to 3 widths off, round the circle or up to the ends. Other places keep theirs."""
        first, count, circular = (x[:, None] for x in self.kind_of(targets.shape[1]))  # (T, 1)
        bin = torch.arange(self.tokens.vocabulary, device=targets.device) - first  # (T, V)
        of_target = targets[:, :, None] - first  # (B, T, 1)
        far = (bin - of_target).abs()
        far = torch.where(circular > 0, torch.minimum(far, count - far), far)
        near = (bin >= 0) & (bin < count) & (far <= 3 * width)
        logits = widened(logits)
        share = torch.where(near, torch.exp(-(far.to(logits.dtype) ** 2) / (2 * width**2)), 0.0)
        spread = (of_target >= 0) & (of_target < count)
        one = F.one_hot(targets, self.tokens.vocabulary).to(logits.dtype)
        share = torch.where(spread, share / share.sum(2, keepdim=True).clamp(min=1e-30), one)
        each = torch.where(share > 0, -share * logits.log_softmax(2), 0.0).sum(2)
        return torch.where(targets == self.tokens.pad, 0.0, each)

    def groups(self, decay, table_rate=1.0):
        """Parameters for AdamW: matrices decay; tables whose rows are looked up learn `times` as fast."""
        looked_up = {
            id(part.weight) for name, part in self.named_modules() if isinstance(part, Table) and not name.startswith("head")
        }
        role = lambda p: "table" if id(p) in looked_up else "matrix" if p.dim() == 2 else "vector"
        pick = lambda which: [p for p in self.parameters() if role(p) == which]
        return [
            {"params": pick("matrix"), "weight_decay": decay, "times": 1.0},
            {"params": pick("vector"), "weight_decay": 0.0, "times": 1.0},
            {"params": pick("table"), "weight_decay": 0.0, "times": table_rate},
        ]

    def deviation(self, name):
        """Of the numbers that a matrix of this name begins with."""
        return deviation(name.split(".")[-2], self.config.layers)
