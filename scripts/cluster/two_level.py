"""kinelm's model of two levels: a trunk in which a row is a frame, and a decoder that spells one (docs/model.md).

F frames of a window, C characters of a frame and W = C + 1 of its tokens, S the most bins of a place, D and d the widths.
Goal conditioning and music are learnt by `kinelm pretrain` and `kinelm finetune` alone.
"""
from dataclasses import dataclass, field

import torch
from torch import nn
from torch.nn import functional as F

from answers import Answers, counts
from blocks import Linear, Projection, Table, deviation, stack
from forecast import HISTORY, NUMBERS, Forecast, numbers, reached, steps

BACK = 2  # frames that the trunk reads


@dataclass
class Stack:
    """A stack of blocks; of `[model.decoder]` with the numbers by which the trunk is told a character."""

    layers: int = 2
    heads: int = 4
    width: int = 128
    character_width: int = 24
    kind: str = "causal"
    dropout: float = 0.0


@dataclass
class TwoLevelConfig:
    """The `[model]` table."""

    architecture: str = "two_level"
    kind: str = "causal"
    layers: int = 4
    heads: int = 4
    width: int = 128
    context: int = 0
    positions: str = "frame_joint"
    dropout: float = 0.0
    tied_head: bool = False
    previous_frame: bool | None = True
    head: str | None = "relative"
    window: int = 128
    decoder: dict = field(default_factory=dict)
    goal: bool = False
    forecast: bool = True
    music: str = "none"
    music_scale: dict | None = None

    def resolved(self, tokens):
        """With what the window says; what can't be is refused."""
        if self.goal or self.music != "none":
            raise ValueError("model.goal and model.music are learnt by `kinelm pretrain` and `finetune` alone; leave them out")
        if not tokens.places or tokens.varying:
            raise ValueError("a two-level model spells frames of bins; words of this tokenizer are others")
        said = {"kind": "causal", "previous_frame": True, "head": "relative", "architecture": "two_level"}
        for key, value in said.items():
            if getattr(self, key) not in (value, None):
                raise ValueError(f"model.{key} is {getattr(self, key)!r}; a two-level model has {value!r}: leave it out")
        keys = ("layers", "heads", "width", "character_width")
        for key in self.decoder:
            if key not in keys:
                raise ValueError(f"[model.decoder] has `{key}`; expected one of {', '.join(keys)}")
        if not 2 <= self.window <= 8192:
            raise ValueError(f"model.window is {self.window}; expected 2 to 8192")
        decoder = Stack(**self.decoder)
        for name, s in [("model", self), ("model.decoder", decoder)]:
            if s.width % s.heads:
                raise ValueError(f"{name}.width is {s.width} and heads {s.heads}; expected heads that divide the width")
        own = {key: getattr(decoder, key) for key in keys}
        told = {"context": self.window * tokens.word + tokens.front - 1, "tied_head": False, "decoder": own}
        return TwoLevelConfig(**{**self.__dict__, **said, **told, "positions": "frame_joint"})

    def stated(self):
        """As kinelm.json has it."""
        return {key: value for key, value in vars(self).items() if key != "music_scale"}


class TwoLevel(Answers):
    def __init__(self, config, tokens):
        c = config.resolved(tokens)
        decoder = Stack(**c.decoder)
        super().__init__(c, tokens, decoder.width)
        self.history = HISTORY if c.forecast else 0
        self.characters = tokens.word - 1
        self.circular, self.clamped = counts(tokens)
        self.bins = max(self.circular, self.clamped)  # S
        self.steps = self.circular + max(2 * self.clamped - 1, 0)  # R
        D, d, e, C = c.width, decoder.width, decoder.character_width, self.characters
        frame = {"character": Table(C * (self.bins + 1), e), "position": Table(c.window, D), "join": Linear(BACK * C * e, D)}
        self.frame = nn.ModuleDict(frame)
        self.trunk = nn.ModuleDict({"block": stack(c), "norm": nn.LayerNorm(D, 1e-5)})
        self.spell = nn.ModuleDict({
            "frame": Linear(D, d), "last": Table(self.steps + 1 + self.bins, d), "place": Table(tokens.word, d),
            "character": Table(self.bins + 1, d), "step": Table(self.steps + 1, d), "block": stack(decoder),
        })
        if c.forecast:
            self.forecast = Forecast(C)
            self.spell["innovation"] = Table(self.steps + 1, d)
            self.spell["forecast"] = Projection(NUMBERS, d)
        for level, width in ((self.frame, D), (self.spell, d)) if tokens.front > 1 else ():
            level["label"] = Table(tokens.vocabulary, width)
            nn.init.zeros_(level["label"].weight)
        of_place = torch.tensor(tokens.place_ids())  # (C, 3): first id, bins, goes round
        self.register_buffer("of_place", of_place.long(), persistent=False)

    def read(self, ids):
        """As Answers.read; (B, T, d) states, zeros for the tokens of the front but its last."""
        K, W, H = self.tokens.front, self.tokens.word, self.history
        B, T = ids.shape[0], ids.shape[1] - H * W
        frames = -(-(T - K + 1) // W)
        words = F.pad(ids[:, K:], (0, frames * W - (T - K)), value=self.tokens.pad).view(B, H + frames, W)
        all = F.pad(self.codes(words), (0, 0, 2, 0), value=-1)  # (B, 2 + H + F, C)
        now, *before = [all[:, 2 + H - n : 2 + H - n + frames] for n in (0, 1, 2)]
        base, forecast = before[0], None
        if H:
            _, count, circular = self.of_place.unbind(1)
            forecast = self.forecast(all[:, 2:], count, circular)[:, H:]
            base = reached(before[0], forecast, count, circular)
        spoken = self.spell["frame"](self.trunk_rows(before, ids[:, 1:K]))
        if "label" in self.spell:
            spoken = spoken + self.spell["label"](ids[:, 1:K]).sum(1, keepdim=True)
        x = (spoken[:, :, None] + self.spelt(now, *before, base, forecast)).view(B * frames, W, -1)
        for block in self.spell["block"].values():
            x = block(x)
        states = F.pad(x.reshape(B, frames * W, -1)[:, : T - K + 1], (0, 0, K - 1, 0))
        counts = F.pad(torch.where(base >= 0, base + self.of_place[:, 0], -1), (0, 1), value=-1).view(B, frames * W)
        counts = F.pad(counts, (K - 1, 0), value=-1)[:, :T]
        return torch.cat([ids[:, :K], ids[:, K + H * W :]], 1), states, counts

    def codes(self, words):
        """Bins (B, F, C) of words (B, F, W), -1 where a token is none of its place's."""
        first, count, _ = self.of_place.unbind(1)
        bin = words[..., : self.characters] - first
        return torch.where((bin >= 0) & (bin < count), bin, -1)

    def or_missing(self, bins):
        """Rows of a table of characters: the last for one that is missing."""
        return torch.where(bins >= 0, bins, self.bins)

    def trunk_rows(self, before, labels):
        """(B, F, D) behind the trunk's norm."""
        seen = self.or_missing(torch.cat(before, 2))
        seen = seen + (self.bins + 1) * torch.arange(self.characters, device=seen.device).repeat(BACK)
        x = self.frame["join"](self.frame["character"](seen).flatten(2))
        x = x + self.frame["position"].weight[: seen.shape[1]]
        if "label" in self.frame:
            x = x + self.frame["label"](labels).sum(1, keepdim=True)
        for block in self.trunk["block"].values():
            x = block(x)
        return self.trunk["norm"](x)

    def step(self, to, since):
        """The row of the step from one bin of a place to another (B, F, C)."""
        _, count, circular = self.of_place.unbind(1)
        by = to - since
        return torch.where(circular > 0, by % count, self.circular + self.clamped - 1 + by)

    def spelt(self, now, a, b, base, forecast):
        """(B, F, W, d) what the decoder reads of bins (B, F, C) of this frame, of the one before and of that before it, and of
        a forecast of this frame's steps, which lead to the bins `base`."""
        begin = torch.full_like(now[..., :1], self.steps)
        step = lambda to, since: torch.where((to >= 0) & (since >= 0), self.step(to, since), self.steps)
        # behind each character the step that led to it, its bin in a first frame
        last = torch.where((now >= 0) & (a < 0), self.steps + 1 + now, step(now, a))
        space = begin - self.steps + self.bins
        table = self.spell
        x = table["last"](torch.cat([begin, last], 2)) + table["place"].weight
        x = x + table["character"](torch.cat([self.or_missing(a), space], 2))
        x = x + table["step"](torch.cat([step(a, b), begin], 2))
        if forecast is None:
            return x
        x = x + table["innovation"](torch.cat([begin, step(now, base)], 2))
        _, count, circular = self.of_place.unbind(1)
        told = numbers(forecast, steps(b, a, count, circular)) * (a >= 0)[..., None]
        return x + F.pad(table["forecast"](told.to(x.dtype)), (0, 0, 0, 1))

    def uncounted(self, ids):
        """As Answers.uncounted, of the window alone."""
        K, W = self.tokens.front, self.tokens.word
        return super().uncounted(torch.cat([ids[:, :K], ids[:, K + self.history * W :]], 1))

    def deviation(self, name):
        if name == "spell.forecast.weight":
            return 0.0
        layers = self.config.decoder["layers"] if name.startswith("spell.") else self.config.layers
        return 0.0 if name.endswith(".label.weight") else deviation(name.split(".")[-2], layers)
