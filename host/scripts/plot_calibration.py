# SPDX-License-Identifier: MIT
"""Plot a calibration: raw and compensated bias against temperature, before and after, and the error of the
polynomial that was learned against the error the filter predicted.

    plot_calibration.py REPORT.json -o PICTURE.png

REPORT.json is what demo.py writes; its fields and the drawing: imucal.plot.calibration.
"""

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "python"))
from imucal.plot import calibration_figure as plot  # noqa: E402


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("report")
    parser.add_argument("-o", "--output", required=True)
    options = parser.parse_args()
    with open(options.report) as file:
        plot(json.load(file)).savefig(options.output, dpi=130)


if __name__ == "__main__":
    main()
