#!/usr/bin/env python3
"""What the studio's server takes, without a browser: python3 scripts/bench/studio.py target/release/kinelm

Prints one line of JSON for each figure, those of `kinelm-lab decode` in the same run:
  start        seconds from the call to the line with the address, and to the page
  first_frame  milliseconds from the request for a dance to its first sampled frame in the event stream
  variations   frames a second of four dances side by side, from the first to the last frame in the stream
  load         seconds for 200 requests at once
  memory       megabytes of the process, empty and with N clips of a minute that were read and shown

Needs Python 3.9 or newer and nothing else. Clips are dances of the program itself.
"""

import argparse
import base64
import http.client
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import threading
import time


class Studio:
    def __init__(self, program, folder, *words):
        self.begun = time.monotonic()
        environment = dict(os.environ, XDG_CACHE_HOME=str(folder / "cache"))
        call = [program, "studio", "--no-open", "--empty", *words]
        self.process = subprocess.Popen(call, cwd=folder, stdout=subprocess.PIPE, text=True, env=environment)
        file = self.process.stdout.readline().strip().removeprefix("kinelm studio: open ")
        self.listens_s = time.monotonic() - self.begun
        address = pathlib.Path(file).read_text().split("url=http://")[1].split('"')[0]
        self.host, path = address.split("/", 1)
        connection = http.client.HTTPConnection(self.host)
        connection.request("GET", "/" + path)
        answer = connection.getresponse()
        self.head = {"Cookie": answer.getheader("set-cookie").split(";")[0], "Sec-Fetch-Site": "same-origin"}
        self.page_s = None

    def call(self, method, path, body=None):
        connection = http.client.HTTPConnection(self.host)
        connection.request(method, path, body, self.head)
        answer = connection.getresponse()
        text = answer.read()
        if answer.status != 200:
            sys.exit(f"studio.py: {method} {path}: {answer.status} {text[:300]}")
        return text

    def json(self, method, path, body=None):
        return json.loads(self.call(method, path, None if body is None else json.dumps(body)))

    def events(self):
        """The events from now on: (seconds, name, data)."""
        connection = http.client.HTTPConnection(self.host)
        connection.request("GET", "/api/events", headers=self.head)
        stream = connection.getresponse()
        name = None
        while True:
            line = stream.readline().decode()
            if line.startswith("event: "):
                name = line[7:].strip()
            elif line.startswith("data: "):
                yield time.monotonic(), name, json.loads(line[6:])

    def megabytes(self):
        status = pathlib.Path(f"/proc/{self.process.pid}/status").read_text()
        return int(status.split("VmRSS:")[1].split()[0]) / 1024

    def end(self):
        self.call("POST", "/api/stop", "{}")
        self.process.wait()


def made(studio, make):
    """Milliseconds to the first frame, and frames a second of all dances of a job."""
    events = studio.events()
    next(events)
    asked = time.monotonic()
    job = studio.json("POST", "/api/make", make)["job"]
    first, last, frames = None, None, {}
    for at, name, data in events:
        if name == "frames" and data["job"] == job:
            head = data.get("figure_head")
            points = head["points"] if head else points
            count = len(base64.b64decode(data["data"])) // (points * 6)
            frames[data["dance"]] = data["from"] + count
            if first is None:
                first, seen = at, dict(frames)
            last = at
        elif name == "job" and data["id"] == job and data["state"] in ("done", "failed"):
            if data["state"] == "failed":
                sys.exit(f"studio.py: {data['text']}")
            break
    new = sum(frames.values()) - sum(seen.values())
    return 1e3 * (first - asked), new / (last - first)


def report(what, **figures):
    print(json.dumps({"what": what, **figures}), flush=True)


def spread(values, digits=0):
    return [round(x, digits) for x in (statistics.median(values), min(values), max(values))]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--clips", type=int, default=100)
    args = parser.parse_args()
    program = str(pathlib.Path(args.program).resolve())
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        # the model is written to the cache once, which no later start waits for
        Studio(program, folder, "first").end()
        studio = Studio(program, folder, "project")
        page = time.monotonic()
        studio.call("GET", "/")
        studio.call("GET", "/api/state")
        report("start", listens_s=round(studio.listens_s, 2), page_and_state_ms=round(1e3 * (time.monotonic() - page), 1))
        empty = studio.megabytes()

        free = {"kind": "free", "seconds": 12, "seed": 1}
        first = [made(studio, {**free, "seed": n})[0] for n in range(args.repeats)]
        report("first_frame", of="a free dance", ms=spread(first))
        dance = studio.json("GET", "/api/state")["dances"][0]["id"]
        arm = {"kind": "edit", "clip": dance, "free": ["right_arm"], "variations": 4}
        follow = {"kind": "given", "clip": dance, "joints": "root,right_arm", "variations": 4}
        for name, make in [("an arm", arm), ("root and right arm given", follow), ("free", {**free, "variations": 4})]:
            found = [made(studio, {**make, "seed": n}) for n in range(args.repeats)]
            report("first_frame", of=f"four variations, {name}", ms=spread([ms for ms, _ in found]))
            report("variations", of=name, frames_per_s=spread([rate for _, rate in found]))

        begun = time.monotonic()
        threads = [threading.Thread(target=studio.call, args=("GET", "/api/state")) for _ in range(200)]
        [thread.start() for thread in threads]
        [thread.join() for thread in threads]
        report("load", requests=200, seconds=round(time.monotonic() - begun, 2))

        # a minute at 60 frames a second each
        made(studio, {"kind": "free", "seconds": 60, "seed": 9})
        long = studio.json("GET", "/api/state")["dances"][-1]["id"]
        clip = folder / "long.bvh"
        clip.write_bytes(studio.call("GET", f"/api/dances/{long}/export?format=bvh"))
        subprocess.run([program, "convert", str(clip), str(folder / "minute.bvh"), "--fps", "60", "--quiet"], check=True)
        minute = (folder / "minute.bvh").read_bytes()
        danced = studio.megabytes()
        for n in range(args.clips):
            studio.call("POST", f"/api/clips?name=clip{n}.bvh", minute)
        while any(clip["state"] == "reading" for clip in studio.json("GET", "/api/state")["clips"]):
            time.sleep(0.2)
        read = studio.megabytes()
        clips = studio.json("GET", "/api/state")["clips"]
        for clip in clips:
            studio.call("GET", f"/api/clips/{clip['id']}/figure?fps=10&seconds=4")
        small = studio.megabytes()
        for clip in clips:
            studio.call("GET", f"/api/clips/{clip['id']}/figure")
        report(
            "memory", clips=len(clips), megabytes_each=round(len(minute) / 1e6, 1), empty=round(empty), danced=round(danced),
            read=round(read), shown_small=round(small), shown_whole=round(studio.megabytes()),
        )
        studio.end()
    for config in ("two-level",):
        bench = [f"{program}-lab", "decode", "--config", config, "--streams", "4", "--weights", "int8"]
        bench += ["--repeats", str(args.repeats), "--json"]
        done = subprocess.run(bench, capture_output=True, text=True)
        for line in done.stdout.splitlines():
            if '"generate"' in line or "generate" in line:
                print(line, flush=True)
        if done.returncode:
            sys.exit(f"studio.py: {' '.join(bench)}: {done.stderr[-400:]}")


if __name__ == "__main__":
    main()
