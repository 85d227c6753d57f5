"""Damage to files, of one seed after the other, which tests share."""

import os
import re
import struct

import numpy as np

N_MUTATIONS = int(os.environ.get("BSPLINE_MDAO_FUZZ", "25"))
"""Mutations of every kind of file: few each time, many before a release."""

NUMBERS = [
    ("i", -1),
    ("i", 0),
    ("i", 2**31 - 1),
    ("i", 2**24),
    ("q", 2**62),
    ("f", np.nan),
    ("d", np.nan),
    ("d", 1e300),
]
SPECIAL = [struct.pack(order + code, value) for order in "<>" for code, value in NUMBERS]
WORDS = [
    b"*",
    b"99999*",
    b"1e999",
    b"NaN",
    b"-1",
    b",,",
    b"\0",
    b"99999999999",
    b"[[",
    b'"',
    b"\n",
    b"{",
    b"}",
    b"=",
    b"\xff",
]


def overwrite(data, at, word):
    return data[:at] + word + data[at + len(word) :]


MUTATIONS = [
    lambda data, at, random: data[:at],
    lambda data, at, random: data[:at] + data[at + random.integers(1, 40) :],
    lambda data, at, random: data[:at] + random.bytes(random.integers(1, 40)) + data[at:],
    lambda data, at, random: overwrite(data, at, random.bytes(1)),
    lambda data, at, random: overwrite(data, at & ~3, SPECIAL[random.integers(len(SPECIAL))]),
    lambda data, at, random: data[:at] + WORDS[random.integers(len(WORDS))] + data[at:],
    lambda data, at, random: overwrite(data, at, WORDS[random.integers(len(WORDS))]),
    lambda data, at, random: data[:at] + data[max(0, at - random.integers(1, 40)) :],
    lambda data, at, random: data + data[:at],
]


def mutate(data, random, mutations=MUTATIONS, head=64):
    """Damage data in one or two places, every other time near its beginning."""
    for _ in range(random.integers(1, 3)):
        reach = len(data) if random.integers(2) else min(head, len(data))
        data = mutations[random.integers(len(mutations))](data, int(random.integers(reach + 1)), random)
    return data


NUMBERS_IN_TEXT = [b"0", b"-1", b"7", b"1000000007", b"-1000000000", b"99999999999999999999", b"nan", b"1e999", b"2.5"]


def drop_line(data, at, random):
    """Drop a line."""
    first, last = data.rfind(b"\n", 0, at) + 1, data.find(b"\n", at) + 1
    return data[:first] + data[last or len(data) :]


def double_line(data, at, random):
    """Write a line twice."""
    first, last = data.rfind(b"\n", 0, at) + 1, data.find(b"\n", at) + 1
    return data[: last or len(data)] + data[first:]


def replace_number(data, at, random):
    """Put another number in the place of the next one."""
    found = re.compile(rb"[-+]?\d[\d.]*(?:e[-+]?\d+)?").search(data, at)
    word = NUMBERS_IN_TEXT[random.integers(len(NUMBERS_IN_TEXT))]
    return data[: found.start()] + word + data[found.end() :] if found else data


def flip_bit(data, at, random):
    """Flip a bit."""
    return overwrite(data, at, bytes([data[at] ^ (1 << int(random.integers(8)))])) if at < len(data) else data


MUTATIONS_OF_LINES = [*MUTATIONS, drop_line, double_line, replace_number, replace_number, replace_number, flip_bit]
"""Those of files with numbers in lines."""
