# SPDX-License-Identifier: MIT
"""``imucal plot``: a picture of a table, or of the result (--json) of a program."""
import io

from .cli import common_options, finish_json, parser_of
from .errors import UsageError
from .inputs import plain_file
from .log import keep_input, read_log, write_bytes
from .strict import read_json

_KINDS = ("png", "svg", "pdf")


def _parser():
    parser = parser_of("plot", "A picture of a table, or of the result (--json) of calibrate fit, dp, errormodel or profile.")
    parser.add_argument("file", metavar="RESULT.json")
    parser.add_argument("-o", "--output", required=True, metavar="PICTURE.png|svg|pdf")
    parser.add_argument("--log", action="append", default=[], metavar="LOG.csv",
                        help="a log to draw under the polynomial of a table, repeatable")
    common_options(parser)
    return parser


def run(arguments):
    """Run the command; returns the exit status."""
    given = _parser().parse_args(arguments)
    kind = given.output.rpartition(".")[2].lower()
    if kind not in _KINDS:
        raise UsageError(f"-o {given.output}: expected a name that ends in .{', .'.join(_KINDS)}")
    keep_input(given.file, given.output, given.json)
    from .plot.results import result_figure
    with plain_file(given.file) as source:
        figure = result_figure(read_json(source), given.file, [read_log(path) for path in given.log])
    data = io.BytesIO()
    figure.savefig(data, format=kind, dpi=110)
    write_bytes(given.output, data.getvalue())
    if not given.quiet and given.json != "-":
        print(f"picture: {given.output}")
    finish_json(given.json, {"file": given.file, "output": given.output})
    return 0
