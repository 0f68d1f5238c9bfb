# SPDX-License-Identifier: MIT
"""Labels are encrypted with a one-time key before the first diagnosis; the digest is printed, then checked."""
from __future__ import annotations

import hashlib
import json
import os
import secrets
import zlib

import numpy as np


def _stream(key, size):
    parts = (hashlib.sha256(key + i.to_bytes(8, "little")).digest() for i in range(size // 32 + 1))
    return np.frombuffer(b"".join(parts)[:size], np.uint8)


def seal(labels, folder):
    """Writes the sealed labels; returns the digest that is printed before the first diagnosis."""
    os.makedirs(folder, exist_ok=True)
    plain, key = zlib.compress(json.dumps(labels, default=float).encode()), secrets.token_bytes(32)
    hidden = (np.frombuffer(plain, np.uint8) ^ _stream(key, len(plain))).tobytes()
    with open(os.path.join(folder, "labels.sealed"), "wb") as out:
        out.write(hidden)
    handle = os.open(os.path.join(folder, "labels.key"), os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(handle, "wb") as out:
        out.write(key)
    return hashlib.sha256(hidden).hexdigest()


def unseal(folder, digest=None):
    """Labels again; refuses a file that is not the one whose digest was printed."""
    with open(os.path.join(folder, "labels.sealed"), "rb") as f:
        hidden = f.read()
    if digest is not None and hashlib.sha256(hidden).hexdigest() != digest:
        raise ValueError(f"{folder}/labels.sealed changed after sealing: draw the cases again")
    with open(os.path.join(folder, "labels.key"), "rb") as f:
        key = f.read()
    return json.loads(zlib.decompress((np.frombuffer(hidden, np.uint8) ^ _stream(key, len(hidden))).tobytes()))
