# SPDX-License-Identifier: MIT
"""JSON against Python's own: what our programs write is read by it, and of odd or damaged text both say the same."""
import json
import math
import random
import subprocess

import pytest

from where import BIN

MODEL = ('{ "imucal_model": 1, "arw_deg_rt_h": 0.625,\n  "markov": [ {"sigma_dph": 20, "tau_s": 1.0e2}, {"sigma_dph": 5.5, "tau_s": 900} ],\n'
         '  "turn_on_sigma_dph": 0, "comment": "\\u00e9 \\ud83d\\ude00 \\n", "unit": "dph" }\n')


def strict(text):
    """Python's reading, less what JSON does not have (NaN, halves of surrogates) and what our programs refuse (a field twice, 1e999)."""
    def pairs(items):
        if len(dict(items)) < len(items):
            raise ValueError("twice")
        return dict(items)

    def number(word):
        if math.isinf(float(word)):
            raise ValueError(word)
        return float(word)

    def constant(word):
        raise ValueError(word)

    data = json.loads(text, object_pairs_hook=pairs, parse_float=number, parse_constant=constant)
    json.dumps(data, ensure_ascii=False).encode()
    return data


def expect(folder, text):
    """(status, curve) of `errormodel expect` on this text; the curve is None where it is refused."""
    path = folder / "model.json"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    done = subprocess.run([BIN / "errormodel", "expect", path, "--tau", "2:20:2", "--json", "-"], capture_output=True, timeout=20)
    assert done.returncode in (0, 3), (text, done)
    if done.returncode == 0:
        return 0, strict(done.stdout)["dp_dph"]
    assert done.stdout == b"" and b"model.json" in done.stderr and b"internal error" not in done.stderr and b"terminate" not in done.stderr, (text, done)
    return 3, None


def damaged(text, rng):
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        at, to = sorted(rng.choices(range(len(text) + 1), k=2))
        put = rng.choice([*'{}[]",:.-+eE0123456789 \\\t\n\x01\x7f/ntfu', "\\u", "\\ud800", "1e999", "null", "true", "NaN", "\u00e9", "\u2028", "00", ",,", "//"])
        text = rng.choice([text[:at] + put + text[at:], text[:at] + put + text[at + 1:], text[:at] + text[at + 1:], text[:at],
                           text[:at] + text[to:], text[:to] + text[at:to] + text[to:]])
    return text


@pytest.mark.parametrize("seed", range(6))
def test_damaged_models_get_the_answer_that_pythons_reading_gets(tmp_path, seed):
    """Text that Python refuses has status 3; all other text the answer of the same data as Python writes them."""
    rng, n_refused, n_read = random.Random(seed), 0, 0
    for _ in range(70):
        text = damaged(MODEL, rng)
        status, curve = expect(tmp_path, text)
        try:
            data = strict(text)
        except ValueError:
            n_refused += 1
            assert status == 3, text
            continue
        n_read += 1
        assert expect(tmp_path, json.dumps(data)) == (status, curve), text
    assert n_refused > 20 and n_read > 3


NUMBERS = ["0.6", "6e-1", "6E-01", "0.06e+1", "60e-2", "1", "1.0", "0.60000000000000000000000000001", "1.00000000000000011102230246251565", "12345.6789", "1e-3"]


@pytest.mark.parametrize("word", NUMBERS)
def test_white_noise_is_that_of_the_number_python_reads(tmp_path, word):
    """By hand: the Allan deviation of white noise is 60 a / sqrt(tau)."""
    status, curve = expect(tmp_path, '{"imucal_model": 1, "arw_deg_rt_h": %s}' % word)
    assert status == 0
    assert curve == pytest.approx([60 * json.loads(word) / math.sqrt(tau_s) for tau_s in range(2, 21, 2)], rel=1e-13)


ODD = ['"\\u00e9\\ud83d\\ude00\\"\\\\\\/\\b\\f\\n\\r\\t"', '"\u00e9\U0001f600\u2028\x7f"', '"\\u0000"', "[" * 98 + "]" * 98, '{"a":' * 98 + "1" + "}" * 98, "1e308",
       "-1.7976931348623157e308", "5e-324", "1e-400", "-0", "-0.0", "9223372036854775807", "-9223372036854775808", "9223372036854775808", "1" * 300, "null", "{}",
       "[]", '""', "[true, false, null]"]
WRONG = ["NaN", "Infinity", "-Infinity", "01", "1.", ".5", "+5", "-", "1e", "0x10", "'x'", '"\t"', '"\\x"', '"\\u12"', '"\\ud800"', '"\\udc00\\ud800"', "[1,]",
         "[1", "{1:2}", '{"a"}', "tru", "True", "", "1 2", "1e999", "/**/1", '{"a": 1, "a": 2}']


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"], ids=["plain", "bom"])
@pytest.mark.parametrize("value", ODD)
def test_odd_comments_change_nothing(tmp_path, value, mark):
    text = '{"imucal_model": 1, "comment": %s, "arw_deg_rt_h": 0.6}' % value
    assert strict(text)["arw_deg_rt_h"] == 0.6
    assert expect(tmp_path, mark + text.encode()) == expect(tmp_path, '{"imucal_model": 1, "arw_deg_rt_h": 0.6}') != (3, None)


@pytest.mark.parametrize("value", WRONG)
def test_wrong_values_are_refused_by_both(tmp_path, value):
    text = '{"imucal_model": 1, "comment": %s, "arw_deg_rt_h": 0.6}' % value
    with pytest.raises(ValueError):
        strict(text)
    assert expect(tmp_path, text) == (3, None)


@pytest.mark.parametrize("tail", [b"\0", b"\0\0\0\0", b'\0 "arw_deg_rt_h": 6}'])
def test_zero_bytes_after_the_object_are_refused(tmp_path, tail):
    assert expect(tmp_path, b'{"imucal_model": 1, "arw_deg_rt_h": 0.6}' + tail) == (3, None)


@pytest.mark.parametrize("name", ['a"b.csv', "a\\b.csv", "\u00e9\U0001f600.csv", "tab\there.csv", "line\nend.csv", "\x01\x7f.csv", "\u2028.csv"])
def test_names_of_logs_come_back_through_python(tmp_path, name):
    rows = "".join(f"{i},{20 + i / 100:.2f},{(i * 37) % 11}\n" for i in range(600))
    (tmp_path / name).write_text("t_s,temp_degc,gx_dph\n" + rows)
    done = subprocess.run([BIN / "dp", name, "--json", "-"], capture_output=True, timeout=20, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert {curve["log"] for curve in strict(done.stdout)["curves"]} == {name}
