"""Bits a frame of clips, as `kinelm evaluate likelihood` measures them."""
import math

import numpy as np
import torch

import windows

BATCH_TOKENS = 16384


@torch.no_grad()
def likelihood(model, parts, conditions, about, most, place, split="valid"):
    """Bits a frame on a split's clips of some corpora, `None` where there are none; `most` 0: of all windows.

    A masked model is asked for 15 % of each window, the same at every call: its bits, called pseudo, are no likelihood.
    """
    model.eval()
    room = windows.room(about.config, about.tokens)
    of = lambda corpus, clip: windows.eval_windows(corpus.words(clip), room)
    every = [[(clip, *w) for clip in corpus.split(split) for w in of(corpus, clip)] for corpus, _ in parts]
    all = sum(map(len, every))
    shares = [len(some) if most == 0 else -(-most * len(some) // max(1, all)) for some in every]
    found = [measured(model, corpus, some, share, conditions, about, place)
             for (corpus, _), some, share in zip(parts, every, shares) if some]
    if not found:
        return None
    total = lambda key: sum(f[key] for f in found)
    return {
        "bits_per_frame": sum(f["nats"] / f["tokens"] * f["shown"] for f in found) / math.log(2) / total("frames"),
        "nats_per_token": total("nats") / total("tokens"), "tokens": int(total("tokens")),
        "frames": round(total("frames")), "windows": total("windows"), "all_windows": all,
        "pseudo": about.config.kind == "masked",
    }


def measured(model, corpus, every, most, conditions, about, place):
    """Nats, tokens asked for, tokens and frames shown, of some windows of a corpus, spread evenly."""
    tokens, masked = about.tokens, about.config.kind == "masked"
    history = windows.history(about.config, tokens)
    taken = range(len(every)) if most >= len(every) else [i * len(every) // most for i in range(most)]
    length = max(every[i][2] for i in taken) + tokens.front - (0 if masked else 1)
    nats = asked = shown = frames = 0
    mine, size = taken[place.rank :: place.world], max(1, BATCH_TOKENS // length)
    for some in (mine[i : i + size] for i in range(0, len(mine), size)):
        pairs = []
        for number in some:
            clip, start, n, scored = every[number]
            front, ids = conditions.front(corpus.clips[clip]["labels"], tokens.bos), corpus.ids(clip, start, start + n)
            if masked:
                choice = windows.chosen(n, 0, 0, number)
                pairs.append(windows.masked(ids, front, tokens.pad, length, choice))
            else:
                pairs.append(windows.causal(ids, front, tokens.pad, length))
                pairs[-1][1][: tokens.front - 1 + scored] = tokens.pad
                before = corpus.ids(clip, max(0, start - history), start)
                pairs[-1] = windows.with_history(pairs[-1][0], tokens.front, before, history, tokens.pad), pairs[-1][1]
            shown += n - scored
            frames += scored_frames(corpus, clip, start + scored, start + n)
        x, y = (torch.from_numpy(np.stack(side)).to(place.device) for side in zip(*pairs))
        asked += int((y != tokens.pad).sum())
        nats += float(model(x, y).double().sum())
    nats, asked, shown, frames = place.sum(nats, asked, shown, frames)
    return {"nats": nats, "tokens": asked, "shown": shown, "frames": frames, "windows": len(taken)}


def scored_frames(corpus, clip, first, end):
    """Frames of some tokens; those of a word that is scored in part are shared out over its tokens."""
    words, total = corpus.words(clip), 0.0
    from_word, to_word = np.searchsorted(words, first, "right") - 1, np.searchsorted(words, end, "left")
    for w in range(from_word, to_word):
        share = (min(end, words[w + 1]) - max(first, words[w])) / (words[w + 1] - words[w])
        total += float(corpus.frames(clip, w + 1) - corpus.frames(clip, w)) * share
    return total
