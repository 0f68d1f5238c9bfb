# SPDX-License-Identifier: MIT
"""A bad serial line between a program and a device: bytes corrupted, doubled or lost, chunks delayed or overtaken by later
ones, at stated rates.

    with NoisyLine("tcp:localhost:5555", corrupt=1e-3, seed=1) as line:
        calibrate --port line.port ...

Listens on a TCP port of its own; the device is reached over TCP or a pseudo-terminal."""

import os
import random
import select
import socket
import threading
import time
import tty


MAX_DELAY_S = 0.3
CHUNK = 64


class NoisyLine:
    def __init__(self, device, corrupt=0.0, double=0.0, lose=0.0, delay=0.0, reorder=0.0, seed=1):
        """device: "tcp:HOST:PORT" or "/dev/pts/N"; rates per byte and direction.

        delay, reorder: per chunk of up to 64 bytes.  A delayed chunk holds up all behind it for up to MAX_DELAY_S; a reordered
        one comes after the next one, or after MAX_DELAY_S where none follows."""
        self.device, self.rates, self.random = device, (corrupt, double, lose), random.Random(seed)
        self.delay, self.reorder = delay, reorder
        self.n_bytes = self.n_hit = self.n_delayed = self.n_reordered = 0
        self._queues = {"host": [], "device": []}  # to each: [when due, bytes] in the order of sending
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
            ready_ones = select.select(waiting, [], [], 0.002 if any(self._queues.values()) else 0.1)[0]
            self._send_due("device", self._to_device)
            self._send_due("host", lambda data: self._to_host(client, data))
            for ready in ready_ones:
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
                    self._queue("device", self._spoil(data))
                    self._send_due("device", self._to_device)
                else:
                    try:
                        data = os.read(self._device_fd, 4096)
                    except OSError:
                        data = b""
                    if not data:
                        return
                    self._queue("host", self._spoil(data) if client else b"")
                    self._send_due("host", lambda data: self._to_host(client, data))

    def _to_device(self, data):
        os.write(self._device_fd, data)

    @staticmethod
    def _to_host(client, data):
        if client:
            try:
                client.sendall(data)
            except OSError:
                pass

    def _queue(self, to, data):
        """Cuts into chunks; some are delayed, some change places with the next."""
        queue = self._queues[to]
        if not (self.delay or self.reorder):
            queue.append([0.0, data])
            return
        for at in range(0, len(data), CHUNK):
            now_s, draw = time.monotonic(), self.random.random()
            due_s = max(now_s, queue[-1][0] if queue else 0.0)
            chunk = data[at:at + CHUNK]
            if draw < self.delay:
                self.n_delayed += 1
                due_s = max(due_s, now_s + MAX_DELAY_S * self.random.random())
            if queue and len(queue[-1]) == 3:  # the one before waits to be overtaken
                due_s = max(now_s, queue[-2][0] if len(queue) > 1 else 0.0)
                queue[-1:] = [[due_s, chunk], [due_s, queue[-1][1]]]
            elif self.delay <= draw < self.delay + self.reorder:
                self.n_reordered += 1
                queue.append([now_s + MAX_DELAY_S, chunk, "overtake me"])
            else:
                queue.append([due_s, chunk])

    def _send_due(self, to, send):
        queue = self._queues[to]
        while queue and queue[0][0] <= time.monotonic():
            data = queue.pop(0)[1]
            if data:
                send(data)

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
