#!/usr/bin/env python3
"""Beats of kinelm beside librosa's and aubio's, on music whose beats are known: the table of docs/results/music.md.

    apt-get install openttd-openmsx fluidsynth timgm6mb-soundfont
    pip install librosa==0.11.0 mir_eval==0.8.2 mido==1.3.3 aubio-ledfx==0.4.12 soundfile
    cargo build --release && scripts/bench/beats.py target/release/kinelm WORK

WORK keeps what is rendered (1 GB). The truth is the quarters of the MIDI files, from the first note to the last; the
clicks are made here. F-measure: mir_eval, 70 ms, without the first 5 s. Differences are of pairs, with a bootstrap over
pieces (10,000 draws). Every second piece in the order of names was looked at while the tracker was made, the others
were not.
"""
import argparse
import os
import pathlib
import subprocess
import time

import librosa
import mido
import mir_eval
import numpy as np
import soundfile

MIDI = pathlib.Path("/usr/share/games/openttd/baseset/openmsx")
FONT = pathlib.Path("/usr/share/sounds/sf2/TimGM6mb.sf2")
RATE = 22050
KINDS = ["steady", "swing", "ramp", "jump", "noise"]


def quarters(path):
    """Times of the quarters, and whether the tempo stays."""
    midi, changes, notes = mido.MidiFile(path), [], []
    for track in midi.tracks:
        tick = 0
        for event in track:
            tick += event.time
            if event.type == "set_tempo":
                changes.append((tick, event.tempo))
            if event.type == "note_on" and event.velocity > 0:
                notes.append(tick)
    stretches = [(0, 0.0, 500_000)]
    for tick, tempo in sorted(changes, key=lambda c: c[0]):
        start, seconds, before = stretches[-1]
        stretches.append((tick, seconds + (tick - start) * before / 1e6 / midi.ticks_per_beat, tempo))
    starts = np.array([s[0] for s in stretches])

    def seconds(tick):
        start, at, tempo = stretches[np.searchsorted(starts, tick, "right") - 1]
        return at + (tick - start) * tempo / 1e6 / midi.ticks_per_beat

    first, last = -(-min(notes) // midi.ticks_per_beat), max(notes) // midi.ticks_per_beat
    times = np.array([seconds(q * midi.ticks_per_beat) for q in range(first, last + 1)])
    steps = np.diff(times)
    return times, bool(steps.max() / steps.min() < 1.01)


def clicks(seed, kind, seconds=60):
    """Clicks with a thud at each beat and a weaker one between: steady, swung, faster and faster, suddenly, in noise."""
    random = np.random.default_rng([seed, KINDS.index(kind)])
    bpm, at, beats = random.uniform(70, 170), random.uniform(0.1, 0.9), []
    jump, swing = (1.2, 0.8, 1.35)[seed % 3], (0.6, 0.667, 0.7)[seed % 3]
    while at < seconds:
        beats.append(at)
        ramp = bpm * (1 + 0.25 * at / seconds)
        at += 60 / {"ramp": ramp, "jump": bpm if at < seconds / 2 else bpm * jump}.get(kind, bpm)
    y = np.zeros((seconds + 1) * RATE)

    def hit(at, hz, loud, decay):
        t = np.arange(int(0.12 * RATE)) / RATE
        start = round(at * RATE)
        n = min(len(t), len(y) - start)
        y[start:start + n] += (loud * np.exp(-t / decay) * np.sin(2 * np.pi * hz * t))[:n]

    bar = random.choice([3, 4])
    for i, (beat, after) in enumerate(zip(beats, beats[1:])):
        hit(beat, 1500 if i % bar == 0 else 1000, 0.5, 0.01)
        hit(beat, 80, 0.4, 0.04)
        if kind in ("steady", "noise"):
            hit(beat + (after - beat) * 0.5, 2500, 0.2, 0.008)
        if kind == "swing":
            hit(beat + (after - beat) * swing, 2500, 0.25, 0.008)
    if kind == "noise":
        y += 0.1 * random.standard_normal(len(y))
    return (0.7 * y[:seconds * RATE]).clip(-1, 1), np.array(beats)


def of_kinelm(program, wav):
    done = subprocess.run([program, "--threads", "1", "music", "beats", wav], capture_output=True, text=True, check=True)
    return np.array([float(line) for line in done.stdout.splitlines() if not line.startswith("#")])


def of_librosa(wav):
    y, rate = librosa.load(wav, sr=RATE)
    return librosa.beat.beat_track(y=y, sr=rate, units="time")[1]


def of_aubio(wav):
    import aubio

    source = aubio.source(str(wav), RATE, 512)
    tempo, out = aubio.tempo("default", 1024, 512, RATE), []
    while True:
        samples, read = source()
        if tempo(samples):
            out.append(tempo.get_last_s())
        if read < 512:
            return np.array(out)


def f_measure(truth, found):
    trim = mir_eval.beat.trim_beats
    truth, found = trim(truth), trim(found)
    return mir_eval.beat.f_measure(truth, found) if len(found) and len(truth) else 0.0


def kind(truth, found):
    """right, at half or double the tempo, between the beats, or none of these: which F-measure reaches 0.8"""
    between = (truth[1:] + truth[:-1]) / 2
    ways = {"right": [truth], "half": [truth[::2], truth[1::2]], "double": [np.sort(np.append(truth, between))],
            "between": [between]}
    return next((name for name, all in ways.items() if max(f_measure(t, found) for t in all) >= 0.8), "other")


def interval(differences, draws=10_000):
    random, d = np.random.default_rng(26), np.array(differences)
    means = d[random.integers(0, len(d), (draws, len(d)))].mean(1)
    return np.quantile(means, [0.025, 0.975])


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("kinelm")
    parser.add_argument("work", type=pathlib.Path)
    arguments = parser.parse_args()
    arguments.work.mkdir(exist_ok=True)

    pieces = []
    for i, path in enumerate(sorted(MIDI.glob("*.mid"))):
        wav = arguments.work / f"{path.stem}.wav"
        if not wav.exists():
            subprocess.run(["fluidsynth", "-ni", "-q", "-r", "44100", "-g", "0.5", "-F", wav, FONT, path], check=True)
        truth, one = quarters(path)
        groups = ["all pieces", "looked at" if i % 2 == 0 else "not looked at", "one tempo" if one else "tempo changes"]
        pieces.append((path.stem, groups, wav, truth))
    for name in KINDS:
        for seed in range(6):
            wav = arguments.work / f"clicks-{name}-{seed}.wav"
            y, truth = clicks(seed, name)
            if not wav.exists():
                soundfile.write(wav, y, RATE)
            pieces.append((wav.stem, ["clicks", f"clicks, {name}"], wav, truth))

    trackers = {"kinelm": lambda wav: of_kinelm(arguments.kinelm, wav), "librosa": of_librosa, "aubio": of_aubio}
    # compiled and loaded before the clock runs
    [track(pieces[0][2]) for track in trackers.values()]
    rows, spent = [], dict.fromkeys(trackers, 0.0)
    for name, groups, wav, truth in pieces:
        found = {}
        for tracker, track in trackers.items():
            start = time.process_time() + sum(os.times()[2:4])
            beats = track(wav)
            spent[tracker] += time.process_time() + sum(os.times()[2:4]) - start
            found[tracker] = (f_measure(truth, beats), kind(truth, beats))
        rows.append((name, groups, found))
        print(name, *(f"{t} {f:.3f} {k}" for t, (f, k) in found.items()), flush=True)

    seconds = sum(soundfile.info(p[2]).duration for p in pieces)
    print({t: f"{seconds / s:.0f} times real time" for t, s in spent.items()}, f"{seconds / 60:.0f} minutes")
    print("| | pieces | kinelm | librosa | difference, 95 % | aubio | difference, 95 % |\n|---|---|---|---|---|---|---|")
    for group in dict.fromkeys(g for _, groups, _ in rows for g in groups):
        these = [found for _, groups, found in rows if group in groups]
        f = {t: np.array([found[t][0] for found in these]) for t in trackers}
        cells = [f"{f['kinelm'].mean():.3f}"]
        for other in ("librosa", "aubio"):
            d = f["kinelm"] - f[other]
            low, high = interval(d)
            cells += [f"{f[other].mean():.3f}", f"{d.mean():+.3f} ({low:+.3f} to {high:+.3f})"]
        print(f"| {group} | {len(these)} | {' | '.join(cells)} |")
    for group in ("all pieces", "not looked at", "clicks"):
        these = [found for _, groups, found in rows if group in groups]
        for t in trackers:
            kinds = [found[t][1] for found in these]
            print(group, t, {k: kinds.count(k) for k in ("right", "half", "double", "between", "other")})


if __name__ == "__main__":
    main()
