"""kinelm's randomness (crates/store/src/random.rs) in numpy: a stream of ChaCha8 for every (seed, purpose, step, index).

So the same seed begins with the same weights and asks for the same windows here and there.
"""
import hashlib

import numpy as np


def key(seed, purpose, step, index):
    """The key (8) of a stream."""
    numbers = [seed, step, index, len(purpose.encode())]
    text = b"kinelm stream 1" + b"".join(int(n).to_bytes(8, "little") for n in numbers) + purpose.encode()
    return np.frombuffer(hashlib.sha256(text).digest(), "<u4")


def blocks(keys, first, count):
    """ChaCha8's numbers (N, 16 count) of N keys (N, 8), from block `first` on."""
    n = len(keys)
    start = np.empty((16, n, count), np.uint32)
    start[:4] = np.array([0x61707865, 0x3320646E, 0x79622D32, 0x6B206574], np.uint32)[:, None, None]
    start[4:12] = keys.T[:, :, None]
    counter = np.arange(first, first + count, dtype=np.uint64)
    start[12], start[13] = counter.astype(np.uint32), (counter >> np.uint64(32)).astype(np.uint32)
    start[14:] = 0
    x = start.copy()
    for _ in range(4):
        for a, b, c, d in [(0, 4, 8, 12), (1, 5, 9, 13), (2, 6, 10, 14), (3, 7, 11, 15),
                           (0, 5, 10, 15), (1, 6, 11, 12), (2, 7, 8, 13), (3, 4, 9, 14)]:
            for to, by, other, bits in [(a, b, d, 16), (c, d, b, 12), (a, b, d, 8), (c, d, b, 7)]:
                x[to] += x[by]
                x[other] ^= x[to]
                x[other] = (x[other] << np.uint32(bits)) | (x[other] >> np.uint32(32 - bits))
    return np.ascontiguousarray((x + start).transpose(1, 2, 0)).reshape(n, 16 * count)


def u64s(seed, purpose, step, count, index=0):
    """The first `count` 64-bit numbers of a stream."""
    many, found = 1 << 14, []
    for first in range(0, -(-count // 8), many):
        size = min(many, -(-count // 8) - first)
        found.append(blocks(key(seed, purpose, step, index)[None], first, size)[0].view("<u8"))
    return np.concatenate(found)[:count] if found else np.zeros(0, "<u8")


def units(seed, purpose, step, count, index=0):
    """The first `count` numbers in 0..1 of a stream."""
    return (u64s(seed, purpose, step, count, index) >> np.uint64(11)) / 2.0**53


def normal(seed, name, count, sd):
    """A tensor before training, as kinelm begins with it (Box and Muller's method)."""
    u, v = units(seed, f"init {name}", 0, 2 * count).reshape(-1, 2).T
    return (np.sqrt(-2 * np.log(1 - u)) * np.cos(2 * np.pi * v) * sd).astype(np.float32)


def shuffled(seed, purpose, step, count, index=0):
    """0..count in Fisher and Yates's order of a stream."""
    order = list(range(count))
    for last, number in zip(range(count - 1, 0, -1), u64s(seed, purpose, step, count - 1, index).tolist()):
        other = number % (last + 1)
        order[last], order[other] = order[other], order[last]
    return order
