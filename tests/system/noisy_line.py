# SPDX-License-Identifier: MIT
"""A bad serial line between a program and a device: bytes corrupted, doubled or lost at stated rates.

    with NoisyLine("tcp:localhost:5555", corrupt=1e-3, seed=1) as line:
        calibrate --port line.port ...

Listens on a TCP port of its own; the device is reached over TCP or a pseudo-terminal."""

import os
import random
import select
import socket
import threading
import tty


class NoisyLine:
    def __init__(self, device, corrupt=0.0, double=0.0, lose=0.0, seed=1):
        """device: "tcp:HOST:PORT" or "/dev/pts/N"; rates per byte and direction."""
        self.device, self.rates, self.random = device, (corrupt, double, lose), random.Random(seed)
        self.n_bytes = self.n_hit = 0
        self.silent = False  # set True: nothing passes any more, in either direction
        self._stop = threading.Event()

    def __enter__(self):
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = "tcp:127.0.0.1:%d" % self._listener.getsockname()[1]
        self._device_fd = self._open_device()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *unused):
        self._stop.set()
        self._thread.join(5)
        self._listener.close()
        os.close(self._device_fd)

    def _open_device(self):
        if self.device.startswith("tcp:"):
            host, port = self.device[4:].rsplit(":", 1)
            connection = socket.create_connection((host, int(port)))
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return connection.detach()
        fd = os.open(self.device, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(fd)
        return fd

    def _run(self):
        client = None
        while not self._stop.is_set():
            waiting = [self._listener, self._device_fd] + ([client] if client else [])
            for ready in select.select(waiting, [], [], 0.1)[0]:
                if ready is self._listener:
                    if client:
                        client.close()
                    client = self._listener.accept()[0]
                elif ready is client:
                    data = client.recv(4096)
                    if not data:
                        client.close()
                        client = None
                        break
                    os.write(self._device_fd, self._spoil(data))
                else:
                    try:
                        data = os.read(self._device_fd, 4096)
                    except OSError:
                        data = b""
                    if not data:
                        return
                    if client:
                        try:
                            client.sendall(self._spoil(data))
                        except OSError:
                            pass

    def _spoil(self, data):
        if self.silent:
            return b""
        corrupt, double, lose = self.rates
        out = bytearray()
        self.n_bytes += len(data)
        for byte in data:
            draw = self.random.random()
            self.n_hit += draw < corrupt + double + lose
            if draw < corrupt:
                out.append(byte ^ self.random.randrange(1, 256))
            elif draw < corrupt + double:
                out += bytes((byte, byte))
            elif draw < corrupt + double + lose:
                continue
            else:
                out.append(byte)
        return bytes(out)
