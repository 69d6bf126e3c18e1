#!/usr/bin/env python3
"""The weights of crates/music/src/beat/weights.rs: the tracker once more in numpy, up to the pulse, and the fit.

    apt-get install openttd-openmsx freedoom fluidsynth timgm6mb-soundfont
    pip install numpy==2.4.6 scipy==1.17.1 torch==2.15.0 numba==0.68.1 mir_eval==0.8.2 mido==1.3.3 librosa soundfile
    scripts/reproduce/beat_weights.py WORK

Looked at: every second piece of openttd-openmsx by name, the MIDI lumps of Freedoom's two games, 20 clicks (seeds from
1000 on). It prints the tables of weights.rs. About a quarter of an hour on one core.
"""
import pathlib
import struct
import subprocess
import sys

import mir_eval
import numba
import numpy as np
import scipy.signal
import soundfile
import torch

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "bench"))
from beats import FONT, KINDS, MIDI, RATE, clicks, quarters  # noqa: E402

HOP, WINDOW = 256, 1024
FPS = RATE / HOP
LEVELS = [4, 6, 8, 9, 12, 16, 18, 24, 36]
COUNTS = [(parts, phase) for parts in LEVELS for phase in range(parts)]
PLACES = np.array([0, 1 / 4, 1 / 3, 1 / 2, 2 / 3, 3 / 4])
RETURNS = [1, 2, 3, 4, 8]
STRETCH, STEP, AROUND = 32, 8, 16
PENALTY = 0.03


def bank(n=48, low=30, high=10_000):
    mel, hz = lambda f: 2595 * np.log10(1 + f / 700), lambda m: 700 * (10 ** (m / 2595) - 1)
    edges, f = hz(np.linspace(mel(low), mel(high), n + 2)), np.fft.rfftfreq(WINDOW, 1 / RATE)
    out = np.zeros((n, len(f)))
    for i, (a, b, c) in enumerate(zip(edges, edges[1:], edges[2:])):
        out[i] = np.maximum(0, np.minimum((f - a) / (b - a), (c - f) / (c - b)))
        if not out[i].any():
            out[i, np.argmin(abs(f - b))] = 1
    return out / out.sum(1, keepdims=True), edges[1:-1]


BANK, MIDDLES = bank()


def moving_mean(x, n):
    ones = np.ones(int(n) | 1)
    return np.convolve(x, ones, "same") / np.convolve(np.ones(len(x)), ones, "same")


def smooth(x, sigma):
    reach = int(np.ceil(4 * sigma))
    w = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return np.convolve(x, w / w.sum(), "same")


def series(y):
    """(6, F): rises in four bands, lasting change in two."""
    y = np.pad(y, WINDOW // 2)
    window = np.hanning(WINDOW + 1)[:-1]
    starts = np.arange(1 + (len(y) - WINDOW) // HOP) * HOP
    loud = np.concatenate([
        np.log1p(100 * (np.abs(np.fft.rfft(y[s[:, None] + np.arange(WINDOW)] * window)) @ BANK.T))
        for s in np.array_split(starts, 1 + len(starts) // 2000)])
    near = np.pad(loud, ((0, 0), (1, 1)))
    near = np.maximum(np.maximum(near[:, :-2], near[:, 2:]), loud)
    rise = np.zeros_like(loud)
    rise[2:] = np.maximum(0, loud[2:] - near[:-2])
    sums, i, n = np.concatenate([np.zeros((1, 48)), np.cumsum(loud, 0)]), np.arange(len(loud)), 17
    lasting = np.maximum(0, sums[np.minimum(i + n, len(loud))] - 2 * sums[i] + sums[np.maximum(i - n, 0)]) / n
    edges = [0, 200, 800, 3200, np.inf]
    all = [rise[:, (MIDDLES >= a) & (MIDDLES < b)].mean(1) for a, b in zip(edges, edges[1:])]
    all += [lasting[:, MIDDLES < top].mean(1) for top in (2500, 250)]
    level = [x / (np.sqrt(moving_mean(x * x, 6 * FPS)) + 1e-3) for x in all]
    return np.array([smooth(x, 1 if k < 4 else 2) for k, x in enumerate(level)])


def periods(change):
    tempi = 40 * 2 ** (np.arange(125) / 48)
    lags, hop, w = FPS * 60 / tempi, 86, 1033
    x, longest = np.pad(change - moving_mean(change, 2 * FPS), (w // 2, w)), int(FPS * 60 / 40 * 6) + 2
    rows = []
    for start in range(0, len(change) + 1, hop):
        power = abs(np.fft.rfft(x[start:start + w] * np.hanning(w), 2048)) ** 2
        a = np.fft.irfft(power, 2048)[:longest + 1]
        a = a / (a[0] + 1e-9)
        row = np.zeros(len(tempi))
        for k in range(1, 7):
            at = np.minimum((lags * k).astype(int), longest - 1)
            t = lags * k - at
            row += 0.85 ** (k - 1) * ((1 - t) * a[at] + t * a[at + 1])
        rows.append(row - 0.3 * (np.log2(tempi / 130) / 0.9) ** 2)
    octaves = np.arange(125) / 48
    cost = np.minimum(200 * (octaves[:, None] - octaves) ** 2, 12)
    best, back = rows[0], []
    for row in rows[1:]:
        scores = best[None, :] - cost
        back.append(scores.argmax(1))
        best = row + scores.max(1)
    path = [best.argmax()]
    for b in reversed(back):
        path.append(b[path[-1]])
    return np.interp(np.arange(len(change)), np.arange(len(path)) * hop, lags[np.array(path[::-1])])


@numba.njit
def linked(change, period):
    score, back = np.zeros(len(change)), -np.ones(len(change), np.int64)
    for f in range(len(change)):
        best, at = 0.0, -1
        for g in range(max(0, f - int(2 * period[f])), f - int(period[f] / 2) + 1):
            s = score[g] - 1000 * np.log((f - g) / period[f]) ** 2
            if s > best:
                best, at = s, g
        score[f], back[f] = change[f] + best, at
    return score, back


def pulse(change):
    period = periods(change)
    score, back = linked(change / change.std(), period)
    at = len(score) - 1 - int(np.argmax(score[::-1][:int(period[-1] * 1.5)]))
    path = []
    while at >= 0:
        path.append(float(at))
        at = back[at]
    path = np.array(path[::-1])
    first, last = np.median(np.diff(path[:9])), np.median(np.diff(path[-9:]))
    return np.concatenate([np.arange(path[0] - first, 0, -first)[::-1], path,
                           np.arange(path[-1] + last, len(change), last)])


def frames(p, part):
    i = np.clip((part / 12).astype(int), 0, len(p) - 2)
    return p[i] + (part / 12 - i) * (p[i + 1] - p[i])


def heard(x, p, part):
    f = np.clip(frames(p, part), 0, x.shape[1] - 1)
    i = np.minimum(f.astype(int), x.shape[1] - 2)
    return x[:, i] * (1 - (f - i)) + x[:, i + 1] * (f - i)


def beats_of(count, start, end):
    parts, phase = count
    return phase + parts * np.arange(-(-(start * 12 - phase) // parts), -(-(end * 12 - phase) // parts))


def numbers(x, p, start, end):
    """(133, 55): what is weighed of each count of a stretch."""
    around = np.arange(max(0, start - AROUND) * 12, min(len(p), end + AROUND) * 12)
    v = heard(x, p, around)[:4]
    v = (v - v.mean(1, keepdims=True)) / (v.std(1, keepdims=True) + 0.05)
    after = lambda lag: (v[:, :-lag] * v[:, lag:]).mean() if lag < v.shape[1] - 12 else 0.0  # noqa: E731
    returns = {lag: after(lag) for lag in {n * parts for n in RETURNS for parts in LEVELS}}
    mean = heard(x, p, np.arange(start * 12, end * 12)).mean(1) + 0.05
    pace, out = np.median(np.diff(p[start:end + 1])), []
    for count in COUNTS:
        b = beats_of(count, start, end)
        at = heard(x, p, (b + count[0] * PLACES[:, None]).ravel()).reshape(6, 6, -1) / mean[:, None, None]
        on = at[:, 0]
        second = abs(on[:, ::2].mean(1) - on[:, 1::2].mean(1)) / (on.mean(1) + 0.1) if len(b) > 3 else np.zeros(6)
        octaves = np.log2(60 * FPS * 12 / (pace * count[0]) / 110)
        out.append(np.concatenate([np.log(at.mean(2) + 0.1).ravel(), second, np.log(np.median(on, 1) + 0.1),
                                   [returns[n * count[0]] for n in RETURNS], [octaves, octaves ** 2]]))
    return np.array(out)


def rightness(p, start, end, truth):
    """(133): F-measure of each count of a stretch."""
    seconds = frames(p, np.array([start * 12, end * 12.0])) / FPS
    these = truth[(truth >= seconds[0]) & (truth < seconds[1])]
    found = [np.sort(frames(p, beats_of(c, start, end))) / FPS for c in COUNTS]
    return np.array([mir_eval.beat.f_measure(these, f) if len(these) > 1 and len(f) > 1 else 0 for f in found])


def lumps(folder):
    """The MIDI files in Freedoom's WADs."""
    for wad in ("freedoom1", "freedoom2"):
        data = pathlib.Path(f"/usr/share/games/doom/{wad}.wad").read_bytes()
        n, table = struct.unpack("<ii", data[4:12])
        for i in range(n):
            at, size, name = struct.unpack("<ii8s", data[table + 16 * i:table + 16 * i + 16])
            path = folder / f"{name.rstrip(bytes(1)).decode().lower()}.mid"
            if data[at:at + 4] == b"MThd" and not path.exists():
                path.write_bytes(data[at:at + size])
    return sorted(folder.glob("*.mid"))


def sounds(work):
    for path in sorted(MIDI.glob("*.mid"))[::2] + lumps(work):
        wav = work / f"{path.stem}.wav"
        if not wav.exists():
            subprocess.run(["fluidsynth", "-ni", "-q", "-r", str(2 * RATE), "-g", "0.5", "-F", wav, FONT, path], check=True)
        y, rate = soundfile.read(wav, always_2d=True)
        yield wav.stem, scipy.signal.resample_poly(y.mean(1), RATE, rate), quarters(path)[0]
    for kind in KINDS:
        for seed in range(1000, 1004):
            yield f"{kind} {seed}", *clicks(seed, kind)


def main():
    torch.set_num_threads(1)
    work = pathlib.Path(sys.argv[1])
    work.mkdir(exist_ok=True)
    rows, right, shares = [], [], []
    for name, y, truth in sounds(work):
        x = series(y)
        p = pulse(x[:4].mean(0))
        if len(truth) < 16 or len(p) < 3:
            continue
        stretches = [(s, min(s + STRETCH, len(p))) for s in range(0, max(1, len(p) - STRETCH + 1), STEP)]
        f = np.array([rightness(p, *s, truth) for s in stretches])
        # stretches that no count explains teach nothing
        good = f.max(1) >= 0.75
        print(name, f"{f.max(1).mean():.2f}", file=sys.stderr, flush=True)
        rows += [numbers(x, p, *s) for s, g in zip(stretches, good) if g]
        right += list((f >= np.maximum(0.75, f.max(1, keepdims=True) - 0.05))[good])
        shares += [1 / good.sum()] * good.sum()
    x, right, shares = np.array(rows, dtype=np.float32), torch.tensor(np.array(right)), np.array(shares) / sum(shares)
    deviation = x.std((0, 1)) + 1e-6
    x, shares = torch.tensor((x - x.mean((0, 1))) / deviation), torch.tensor(shares, dtype=torch.float32)
    b = torch.zeros(x.shape[2], requires_grad=True)
    fit = torch.optim.LBFGS([b], max_iter=150, line_search_fn="strong_wolfe")

    def loss():
        fit.zero_grad()
        z = x @ b
        told = torch.logsumexp(z.masked_fill(~right, -1e9), 1) - torch.logsumexp(z, 1)
        out = -(shares * told).sum() + PENALTY * (b * b).sum()
        out.backward()
        return out

    fit.step(loss)
    w = (b.detach().numpy() / deviation).round(2)
    for name, part in (("PROFILE", w[:36].reshape(6, 6)), ("ALTERNATION", w[36:42]), ("MIDDLE", w[42:48]),
                       ("RETURN", w[48:53]), ("TEMPO", w[53:])):
        print(name, part.tolist())


if __name__ == "__main__":
    main()
