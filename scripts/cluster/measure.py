"""Bits a frame of clips, as `kinelm evaluate likelihood` measures them."""
import math

import numpy as np
import torch

import windows


@torch.no_grad()
def likelihood(model, parts, conditions, about, most, place, split="valid"):
    """Bits a frame on a split's clips, as `kinelm evaluate likelihood`; None where there is none. `most` 0: all windows."""
    tokens, config = about.tokens, about.config
    of = lambda corpus, clip: windows.eval_windows(corpus.words(clip), windows.room(config, tokens))
    every = [[(c, clip, *w) for clip in c.split(split) for w in of(c, clip)] for c, _ in parts]
    taken = [w for some, n in zip(every, shared_out(most, [len(e) for e in every])) for w in spread(some, n)]
    if not taken:
        return None
    extra = tokens.front - (0 if config.kind == "masked" else 1)
    length = max(w[3] for w in taken) + extra
    model.eval()
    nats = count = frames = 0
    mine = list(range(place.rank, len(taken), place.world))
    size = max(1, 16384 // length)
    for some in (mine[i : i + size] for i in range(0, len(mine), size)):
        pairs = []
        for number in some:
            corpus, clip, start, n, scored = taken[number]
            front, ids = conditions.front(corpus.clips[clip]["labels"], tokens.bos), corpus.ids(clip, start, start + n)
            x, y = windows.causal(ids, front, tokens.pad, length)
            y[: tokens.front - 1 + scored] = tokens.pad
            pairs.append((x, y))
            count += n - scored
            frames += scored_frames(corpus, clip, start + scored, start + n)
        x, y = (torch.from_numpy(np.stack(side)).to(place.device) for side in zip(*pairs))
        nats += float(model.nats(model(x), y).double().sum())
    nats, count, frames = place.sum(nats, count, frames)
    return {"bits_per_frame": nats / math.log(2) / frames, "nats_per_token": nats / count, "tokens": int(count),
            "frames": round(frames), "windows": len(taken), "all_windows": sum(map(len, every))}


def shared_out(most, numbers):
    """Windows of each corpus: all (`most` 0), or in all about `most`, by what they have."""
    return [n if most == 0 else -(-most * n // max(1, sum(numbers))) for n in numbers]


def spread(all, most):
    """So many of them, evenly."""
    return all if most >= len(all) else [all[i * len(all) // most] for i in range(most)]


def scored_frames(corpus, clip, first, end):
    """Frames of some tokens; those of a word that is scored in part are shared out over its tokens."""
    words, total = corpus.words(clip), 0.0
    from_word, to_word = np.searchsorted(words, first, "right") - 1, np.searchsorted(words, end, "left")
    for w in range(from_word, to_word):
        share = (min(end, words[w + 1]) - max(first, words[w])) / (words[w + 1] - words[w])
        total += float(corpus.frames(clip, w + 1) - corpus.frames(clip, w)) * share
    return total
