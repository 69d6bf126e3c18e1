"""What feet.sh measures. Plain Python; kinematics of its own, so that kinelm isn't measured by kinelm.

    feet.py toes REAL SKIP FLOOR DANCE..   per dance, which stands on y = 0: percent of its frames in which the lowest toe
                                     end is more than 2 cm below the 5th percentile of the real clip's above its FLOOR,
                                     metres; jitter of ankles and knees, m/s^3
    feet.py repeat CLIP OUT SECONDS  CLIP again and again, for so long

Files are the BVH of cmu-dance or dances on its rig: centimetres, feet without balls, their toes end sites.
"""

import math
import sys

ANKLES, KNEES = ("lFoot", "rFoot"), ("lShin", "rShin")


class Bvh:
    def __init__(self, path, skip=0):
        self.names, self.parents, self.offsets, self.channels, self.ends = [], [], [], [], {}
        with open(path) as file:
            lines = iter(file.read().splitlines())
        opened, new, self.header = [], None, []
        for line in lines:
            self.header.append(line)
            word = line.split()
            if not word:
                continue
            if word[0] in ("ROOT", "JOINT"):
                new = len(self.names)
                self.names.append(word[1])
                self.parents.append(opened[-1] if opened else None)
                self.offsets.append(None)
                self.channels.append([])
            elif word[0] == "End":
                new = None
            elif word[0] == "{":
                opened.append(new)
            elif word[0] == "}":
                opened.pop()
            elif word[0] == "OFFSET":
                offset = [float(x) for x in word[1:4]]
                if opened[-1] is None:
                    self.ends[opened[-2]] = offset
                else:
                    self.offsets[opened[-1]] = offset
            elif word[0] == "CHANNELS":
                self.channels[opened[-1]] = word[2:]
            elif word[0] == "Frame":
                self.frame_s = float(word[2])
                break
        self.rows = [line for line in lines if line.strip()][skip:]

    def places(self, joints):
        """Per frame the places of joints and of their end sites, metres."""
        needed, first = set(), 0
        for joint in joints:
            while joint is not None:
                needed.add(joint)
                joint = self.parents[joint]
        starts = []
        for channels in self.channels:
            starts.append(first)
            first += len(channels)
        for row in self.rows:
            row = [float(x) for x in row.split()]
            at, turn = {}, {}
            for joint in sorted(needed):
                parent, place = self.parents[joint], list(self.offsets[joint])
                local = None
                for value, channel in zip(row[starts[joint] :], self.channels[joint]):
                    if channel.endswith("position"):
                        place["XYZ".index(channel[0])] = value
                    else:
                        one = about(channel[0], value)
                        local = one if local is None else product(local, one)
                if parent is None:
                    at[joint], turn[joint] = place, local
                else:
                    at[joint] = moved(at[parent], turn[parent], place)
                    turn[joint] = product(turn[parent], local) if local else turn[parent]
            ends = {j: moved(at[j], turn[j], self.ends[j]) for j in joints if j in self.ends}
            yield [[x / 100 for x in at[j]] for j in joints], [[x / 100 for x in end] for end in ends.values()]


def about(axis, degrees):
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return {
        "X": [[1, 0, 0], [0, c, -s], [0, s, c]],
        "Y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
        "Z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
    }[axis]


def product(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def moved(place, turn, by):
    return [place[i] + sum(turn[i][k] * by[k] for k in range(3)) for i in range(3)]


def jitter(track, frame_s):
    third = lambda f: math.hypot(*(track[f + 3][i] - 3 * (track[f + 2][i] - track[f + 1][i]) - track[f][i] for i in range(3)))
    return sum(third(f) for f in range(len(track) - 3)) / max(1, len(track) - 3) / frame_s**3


def measured(path, skip=0):
    bvh = Bvh(path, skip)
    frames = list(bvh.places([bvh.names.index(name) for name in ANKLES + KNEES]))
    lowest = [min(end[1] for end in ends) for _, ends in frames]
    tracks = [[joints[n] for joints, _ in frames] for n in range(4)]
    ankles, knees = [sum(jitter(t, bvh.frame_s) for t in two) / 2 for two in (tracks[:2], tracks[2:])]
    return lowest, ankles, knees


def toes(real, skip, floor, dances):
    lowest = [y - float(floor) for y in measured(real, int(skip))[0]]
    below = sorted(lowest)[round(0.05 * (len(lowest) - 1))] - 0.02
    share = lambda heights: 100 * sum(y < below for y in heights) / len(heights)
    print(f"{real}: {share(lowest):.1f} %")
    for dance in dances:
        heights, ankles, knees = measured(dance)
        print(f"{dance}: {share(heights):.1f} %; jitter of ankles {ankles:.0f}, of knees {knees:.0f} m/s^3")


def repeat(path, out, seconds):
    bvh = Bvh(path)
    frames = round(float(seconds) / bvh.frame_s)
    rows = (bvh.rows * (frames // len(bvh.rows) + 1))[:frames]
    header = [f"Frames: {frames}" if line.startswith("Frames:") else line for line in bvh.header]
    with open(out, "w") as file:
        file.write("\n".join(header + rows) + "\n")


if __name__ == "__main__":
    if sys.argv[1:2] == ["toes"] and len(sys.argv) > 5:
        toes(sys.argv[2], sys.argv[3], sys.argv[4], sys.argv[5:])
    elif sys.argv[1:2] == ["repeat"] and len(sys.argv) == 5:
        repeat(*sys.argv[2:])
    else:
        sys.exit(__doc__)
