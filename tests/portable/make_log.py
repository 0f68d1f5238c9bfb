# SPDX-License-Identifier: MIT
"""usage: make_log.py FILE      Samples for firmware/check: ramp, gaps, lost, saturated and faulty samples."""
import random
import struct
import sys

RATE_HZ, DURATION_S = 20, 600


def main():
    rng = random.Random(4)
    with open(sys.argv[1], "wb") as out:
        for k in range(RATE_HZ * DURATION_S):
            second = k // RATE_HZ
            if 200 <= second < 230 or (second % 53 == 0 and k % RATE_HZ == 3) or (second == 400 and k % RATE_HZ > 6):
                continue
            degc = 62.0 * second / DURATION_S - 1
            tn = (degc - 30) / 30
            counts = [round(80 + 300 * tn - 100 * tn ** 3 + rng.gauss(0, 160)), round(-25 * tn + rng.gauss(0, 5)),
                      round(14000 + 6700 * tn ** 4 + rng.gauss(0, 800))]
            out.write(struct.pack("<BBBBiQ6i", 0xA5, 3, 2 if second == 111 else 0, 4 if second == 333 else 0,
                                  round((degc - 25) * 100 + rng.gauss(0, 2)), k * (1000000 // RATE_HZ) + rng.randrange(900),
                                  *counts, 0, 0, 0))


if __name__ == "__main__":
    main()
