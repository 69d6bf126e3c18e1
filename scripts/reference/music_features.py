#!/usr/bin/env python3
"""Golden figures for crates/music/src/feature and crates/music/src/stft.rs: what librosa makes of a short made-up piece.

    pip install librosa==0.11.0 numpy==2.4.6 scipy==1.17.1
    python3 scripts/reference/music_features.py > crates/music/tests/golden/features.json

The piece is told by a formula, so that the test makes the same samples: decaying chords, a bass, clicks, and noise of a
linear congruential generator. Of each of the 34 numbers that need no beat tracker some frames are kept; the functions and
their arguments are those of EDGE's `baseline_features.py`.
"""
import json
import platform

import librosa
import numpy
import scipy

SECONDS = 6


def noise(n):
    out, state = numpy.empty(n), 12345
    for i in range(n):
        state = (state * 1103515245 + 12345) % 2**31
        out[i] = state / 2**30 - 1
    return out


def piece(rate):
    t = numpy.arange(SECONDS * rate) / rate
    y = numpy.zeros(len(t))
    chords = [(0, (60, 64, 67)), (1.5, (57, 60, 64)), (3, (53, 57, 60)), (4.5, (55, 59, 62))]
    for start, notes in chords:
        on = (t >= start) & (t < start + 1.5)
        for note in notes + (notes[0] - 24,):
            # a little sharp
            hz = 440 * 2 ** ((note - 69 + 0.06) / 12)
            for h in (1, 2, 3):
                y += on * 0.08 / h * numpy.exp(-1.2 * (t - start)) * numpy.sin(2 * numpy.pi * h * hz * t)
    since = numpy.mod(t, 0.5)
    y += 0.3 * numpy.exp(-60 * since) * noise(len(t))
    return y.astype(numpy.float32)


cases = []
for fps in (60, 30):
    rate = 512 * fps
    y = piece(rate)
    envelope = librosa.onset.onset_strength(y=y, sr=rate)
    mfcc = librosa.feature.mfcc(y=y, sr=rate, n_mfcc=20).T
    chroma = librosa.feature.chroma_cens(y=y, sr=rate, hop_length=512, n_chroma=12).T
    peaks = librosa.onset.onset_detect(onset_envelope=envelope.flatten(), sr=rate, hop_length=512)
    at = list(range(0, len(envelope), 17)) + [len(envelope) - 1]
    cases.append({
        "fps": fps, "frames": len(envelope), "at": at,
        "tuning": float(librosa.estimate_tuning(y=y, sr=rate, bins_per_octave=36)),
        "strength": [round(float(envelope[f]), 5) for f in at],
        "mfcc": [[round(float(x), 4) for x in mfcc[f]] for f in at],
        "chroma": [[round(float(x), 5) for x in chroma[f]] for f in at],
        "peaks": [int(f) for f in peaks],
    })

# the dissertation's audio frame at 30 frames per second: 1,067 samples cut out, then transformed with librosa's defaults
rate, y = 16000, piece(16000)
stft = []
for f in (0, 40, 100):
    start = int(numpy.floor(f * rate / 30 + 0.5))
    columns = numpy.abs(librosa.stft(y[start:start + 1067], n_fft=2048, hop_length=200, pad_mode="reflect"))
    assert columns.shape == (1025, 6)
    stft.append({"frame": f, "columns": [[round(float(columns[k, c]), 5) for k in range(0, 1025, 64)] for c in range(6)]})

versions = {"python": platform.python_version(), "librosa": librosa.__version__, "numpy": numpy.__version__,
            "scipy": scipy.__version__}
head = {"script": "scripts/reference/music_features.py", "versions": versions, "seconds": SECONDS}
print(json.dumps(head | {"cases": cases, "stft": stft}))
