# SPDX-License-Identifier: MIT
"""A small host for tests of the firmware: speaks common/link.h, whose message table it reads, to a device."""
import os
import random
import re
import select
import socket
import struct
import subprocess
import time
import zlib

from where import BUILD, ROOT

FORMATS = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "i16": "h", "i32": "i", "f32": "f", "chr": "s"}


def read_message_table():
    text = re.sub(r"\\\n", " ", (ROOT / "common/link.h").read_text())
    ids = {name: (int(i, 16), NAME) for i, name, NAME in re.findall(r"M\((0x\w\w), (\w+), (\w+)\)", text)}
    table = {}
    for name, (number, upper) in ids.items():
        body = re.search(r"#define IMUCAL_LINK_%s\(F, A, N, V\)(.*)" % upper, text).group(1)
        body = re.sub(r'"[^"]*"', "", body)
        fields = re.findall(r"\b([FANV])\(([^)]*)\)", body)
        table[name] = (number, [(kind, [part.strip() for part in rest.split(",")]) for kind, rest in fields])
    return table


MESSAGES = read_message_table()
GUARDED = {"stream", "reboot", "cal_start", "cal_stop", "table_from_cal", "table_begin", "table_data", "table_commit",
           "rollback", "erase"}
NAMES = {number: name for name, (number, _) in MESSAGES.items()}


def encode(name, values):
    out, count = b"", None
    for kind, parts in MESSAGES[name][1]:
        if kind == "N":
            count = values[parts[0]]
            out += struct.pack("<B", count)
        elif kind == "F":
            out += struct.pack("<" + FORMATS[parts[0]], values.get(parts[1], 0))
        elif parts[0] == "chr":
            out += values[parts[1]].encode().ljust(int(parts[2]), b"\0")
        else:
            n = int(parts[2]) if kind == "A" else count
            out += struct.pack("<%d%s" % (n, FORMATS[parts[0]]), *list(values[parts[1]])[:n])
    return out


def decode(name, payload):
    values, at, count = {}, 0, None

    def take(layout):
        nonlocal at
        got = struct.unpack_from("<" + layout, payload, at)
        at += struct.calcsize("<" + layout)
        return got

    for kind, parts in MESSAGES[name][1]:
        if kind == "N":
            (count,) = take("B")
            values[parts[0]] = count
        elif kind == "F":
            (values[parts[1]],) = take(FORMATS[parts[0]])
        elif parts[0] == "chr":
            values[parts[1]] = take(parts[2] + "s")[0].rstrip(b"\0").decode()
        else:
            n = int(parts[2]) if kind == "A" else count
            values[parts[1]] = list(take("%d%s" % (n, FORMATS[parts[0]])))
    assert at == len(payload), (name, payload)
    return values


def cobs(data):
    out, block = bytearray(), bytearray()
    for byte in data:
        if byte == 0:
            out += bytes([len(block) + 1]) + block
            block = bytearray()
        else:
            block.append(byte)
            if len(block) == 254:
                out += b"\xff" + block
                block = bytearray()
    return bytes(out + bytes([len(block) + 1]) + block)


def uncobs(data):
    out, at = bytearray(), 0
    while at < len(data):
        n = data[at]
        out += data[at + 1:at + n]
        at += n
        if n < 255 and at < len(data):
            out.append(0)
    return bytes(out)


def frame(number, sequence, payload):
    raw = bytes([number, sequence]) + payload
    return cobs(raw + struct.pack("<I", zlib.crc32(raw))) + b"\0"


def sample_record(t_us, temp_counts, counts, saturated=0, fault=0):
    counts = list(counts)
    return struct.pack("<BBBBiQ6i", 0xA5, len(counts), saturated, fault, temp_counts, t_us,
                       *(counts + [0] * (6 - len(counts))))


class Silence(Exception):
    """The device did not answer in time."""


class Line:
    """The host's end of the serial line, a tcp: or pty name."""

    def __init__(self, name):
        if name.startswith("tcp:"):
            _, host, port = name.split(":")
            self.socket = connect(host, int(port))
            self.fd = self.socket.fileno()
        else:
            self.fd = os.open(name, os.O_RDWR | os.O_NOCTTY)
        self.sequence, self.held, self.streamed = random.randrange(256), b"", []
        self.hello, self.token, self.number = None, None, 0

    def greet(self):
        """A host begins with HELLO: its nonce makes it unlike the host before."""
        for tries_left in (2, 1, 0):  # a device under load may still be starting, and drops what comes before its UART is on
            try:
                name, self.hello = self.ask("hello", protocol=2, nonce=random.getrandbits(32))
                break
            except Silence:
                if not tries_left:
                    raise
        assert name == "hello_reply"
        return self

    def send_bytes(self, data):
        while data:
            data = data[os.write(self.fd, data):]

    def next_frame(self, timeout_s):
        """(name, sequence, values) or Silence; frames that fail their check are skipped."""
        end = time.monotonic() + timeout_s
        while True:
            while b"\0" in self.held:
                coded, self.held = self.held.split(b"\0", 1)
                raw = uncobs(coded)
                if len(raw) >= 6 and zlib.crc32(raw[:-4]) == struct.unpack("<I", raw[-4:])[0]:
                    name = NAMES[raw[0]]
                    return name, raw[1], decode(name, raw[2:-4])
            left = end - time.monotonic()
            if left <= 0 or not select.select([self.fd], [], [], left)[0]:
                raise Silence()
            data = os.read(self.fd, 65536)
            if not data:
                raise Silence()
            self.held += data

    def ask(self, name, timeout_s=5.0, **values):
        """Sends a request, in a COMMAND where it changes something, and returns (name, values) of its reply; streamed
        records are kept in .streamed."""
        if name in GUARDED and self.token is None:
            self.unlock()
        self.sequence = (self.sequence + 1) & 0xFF
        self.send_bytes(self.command(name, self.sequence, **values) if name in GUARDED else
                        frame(MESSAGES[name][0], self.sequence, encode(name, values)))
        if name == "reboot":
            self.token = None
        return self.reply(timeout_s)

    def unlock(self, seconds=600):
        challenge = self.ask("state", reserved=0)[1]["challenge"]
        name, reply = self.ask("unlock", challenge=challenge, serial=self.hello["serial"], seconds=seconds)
        assert name == "unlock_reply", reply
        self.token, self.number = reply["token"], 0

    def command(self, name, sequence, **values):
        """The frame of a request that changes something; the device is unlocked."""
        self.number += 1
        payload = encode(name, values)
        return frame(MESSAGES["command"][0], sequence,
                     encode("command", dict(token=self.token, number=self.number, request=MESSAGES[name][0],
                                            length=len(payload), payload=payload)))

    def reply(self, timeout_s=5.0):
        while True:
            name, sequence, values = self.next_frame(timeout_s)
            if MESSAGES[name][0] >= 0x80:
                if sequence == self.sequence:
                    return name, values
            else:
                self.streamed.append((name, values))

    def done(self, name, **values):
        got, reply = self.ask(name, **values)
        assert got == "done", (got, reply)
        return reply["status"]

    def info(self):
        return self.ask("info", reserved=0)[1]

    def records_until_end(self, timeout_s=20.0):
        """Streamed records up to the event that the sensor has ended."""
        while not any(n == "event" and v["code"] == 5 for n, v in self.streamed):
            name, _, values = self.next_frame(timeout_s)
            self.streamed.append((name, values))
        records, self.streamed = self.streamed, []
        return records

    def calibrate(self, channels, order=3, lo=0.0, hi=60.0, arw=0.6, sigma=20.0, tau_s=100.0, **more):
        import math
        for channel in channels:
            values = dict(channel=channel, order=order, t0_degc=(lo + hi) / 2, range_degc=(hi - lo) / 2,
                          m=-math.expm1(-1 / tau_s), q=sigma ** 2 * -math.expm1(-2 / tau_s), r=(60 * arw) ** 2,
                          markov_variance=sigma ** 2, prior_sigma=1e4, span_lo_degc=lo, span_hi_degc=hi, arw=arw,
                          n_markov=1, markov_sigma=[sigma], markov_tau_s=[tau_s])
            values.update(more)
            status = self.done("cal_start", **values)
            if status:
                return status
        return 0

    def upload(self, table):
        status = self.done("table_begin", total=len(table), crc=zlib.crc32(table))
        for at in range(0, len(table), 200):
            data = table[at:at + 200]
            status = status or self.done("table_data", offset=at, length=len(data), data=data)
        return status or self.done("table_commit", reserved=0)

    def download(self, slot=255):
        data = b""
        while True:
            name, reply = self.ask("table_read", slot=slot, offset=len(data), length=200)
            assert name == "table_read_reply", reply
            data += bytes(reply["data"])
            if len(data) == reply["total"]:
                return data


def connect(host, port, timeout_s=10.0):
    end = time.monotonic() + timeout_s
    while True:
        try:
            return socket.create_connection((host, port))
        except OSError:
            if time.monotonic() > end:
                raise
            time.sleep(0.02)


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Device:
    """A running device: posix process or QEMU.  Use as a context; .line is its serial line."""

    def __init__(self, port, flash=None, feed=None, serial="pty", extra=(), monitor=None, kernel=None):
        self.port, image = port, BUILD / "firmware" / port
        if port == "posix":
            command = [image / "imucal", "--serial", serial]
            command += ["--flash", flash] if flash else []
            command += ["--feed", feed] if feed else []
            self.process = subprocess.Popen([str(part) for part in command + list(extra)], stdout=subprocess.PIPE,
                                            text=True)
            first = self.process.stdout.readline().split()
            if len(first) != 2:
                raise RuntimeError("the device did not start: %s" % self.process.wait())
            self.name = first[1]
        else:
            machine = {"mps2_an386": "mps2-an386", "nrf51": "microbit", "stm32f405_qemu": "netduinoplus2",
                       "riscv_virt": "virt"}[port]
            tcp = free_port()
            arguments = ["imucal"] + (["flash=%s" % flash] if flash and port != "nrf51" else [])
            arguments += ["feed=%s" % feed] if feed else []
            arguments += list(extra)
            qemu = ["qemu-system-riscv32", "-bios", "none"] if port == "riscv_virt" else ["qemu-system-arm"]
            command = qemu + ["-M", machine, "-kernel", str(kernel or image / "imucal.elf"), "-display", "none",
                       "-serial", "tcp:127.0.0.1:%d,server=on,wait=off,nodelay=on" % tcp, "-monitor", monitor or "none",
                       "-semihosting-config", ",".join(["enable=on,target=native"] + ["arg=%s" % a for a in arguments])]
            self.process = subprocess.Popen(command)
            self.name = "tcp:127.0.0.1:%d" % tcp
            connect("127.0.0.1", tcp).close()
            time.sleep(0.15)  # bytes that come before the firmware has switched its UART on wait for a second in QEMU
        self.line = None

    def __enter__(self):
        self.line = Line(self.name).greet()
        return self

    def __exit__(self, *_):
        self.kill()

    def kill(self):
        """kill -9: a power cut."""
        self.process.kill()
        self.process.wait()
