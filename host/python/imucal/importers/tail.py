# SPDX-License-Identifier: MIT
"""Was a file cut off in its middle?  Recordings end so at a power cut; what stands before is good, and the user should know."""
import os

CUT = "the file ends in the middle of a message, as where the power was cut: what stands before it is taken"
#: of the file's end, enough for some hundred messages
TAIL_BYTES = 1 << 16
#: a chain of messages that leads to the end of the file by chance is shorter
FEWEST_IN_CHAIN = 12
ULOG_TYPES = frozenset(b"FIMPQARDLCSOB")


def _tail(path):
    size = os.path.getsize(path)
    with open(path, "rb") as file:
        file.seek(max(0, size - TAIL_BYTES))
        return file.read(), size


def ulog_is_cut(path):
    """No chain of messages (length of two bytes, type, content: PX4 user guide, ULog file format) leads to the end."""
    data, _ = _tail(path)
    n, longest = len(data), 0
    chain = [0] * (n + 1)
    for i in range(n - 3, -1, -1):
        if data[i + 2] not in ULOG_TYPES:
            continue
        end = i + 3 + data[i] + 256 * data[i + 1]
        if end == n or end < n and chain[end]:
            chain[i] = chain[end] + 1
            longest = max(longest, chain[i])
    return longest < FEWEST_IN_CHAIN


def dataflash_is_cut(path, length_of_type):
    """The last message (A3 95, type, content) does not end with the file; length_of_type: {type: bytes in all}."""
    data, _ = _tail(path)
    at = len(data)
    while (at := data.rfind(b"\xa3\x95", 0, at)) >= 0 and at + 2 < len(data):
        if data[at + 2] in length_of_type:
            return at + length_of_type[data[at + 2]] != len(data)
    return True
